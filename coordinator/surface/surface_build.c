#include "coordinator/surface/surface_build.h"

#include <omp.h>

#include "coordinator/surface/build.h"
#include "worker/base/memory.h"

static void release(struct kiln_build *build)
{
    if (build->blocks != NULL) {
        const uint64_t count = build->object_block[build->scene->object_count];
        for (uint64_t b = 0; b < count; b++)
            kiln_free(&build->blocks[b].parts);
    }
    kiln_free(&build->blocks);
    kiln_free(&build->object_block);
    kiln_free(&build->object_area);
    kiln_free(&build->vertex_chart);
    kiln_free(&build->cell_codes);
}

int kiln_surface_build(struct kiln_surface **surface, const struct kiln_surface_params *params, struct kiln_surface_report *report,
                       struct kiln_error *error)
{
    *surface = NULL;
    *report = (struct kiln_surface_report){0};
    if (params->rank >= params->ranks)
        return kiln_fail(error, KILN_USAGE, "rank %u of %u ranks does not exist: give a rank below their number", params->rank,
                         params->ranks);
    struct kiln_build build = {.params = params,
                               .scene = params->scene,
                               .geometry = params->geometry,
                               .report = report,
                               .threads = params->threads > 0 ? params->threads : (uint32_t)omp_get_max_threads(),
                               .error = error};
    int status = kiln_allocate(&build.surface, 1, sizeof *build.surface, "the surface", error);
    if (status == KILN_OK)
        status = kiln_build_measure(&build);
    if (status == KILN_OK)
        status = kiln_build_cover(&build);
    if (status == KILN_OK)
        status = kiln_build_order(&build);
    if (status == KILN_OK) {
        report->cells_occupied = build.surface->cell_count;
        report->cells_total = build.grid.count[0] * build.grid.count[1] * build.grid.count[2];
        report->cell_size = build.grid.size;
        for (int axis = 0; axis < 3; axis++)
            report->cells[axis] = build.grid.count[axis];
        release(&build); /* the fragments hold what of it is still wanted */
        status = kiln_build_share(&build);
    }
    if (status == KILN_OK) {
        *surface = build.surface;
        build.surface = NULL;
    }
    kiln_surface_destroy(&build.surface);
    release(&build);
    return status;
}
