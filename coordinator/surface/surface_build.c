#include "coordinator/surface/surface_build.h"

#include <omp.h>
#include <string.h>

#include "coordinator/surface/build.h"
#include "worker/base/memory.h"

/* ---- the exchange of a process that works alone: nothing is sent ---- */

static int agree_alone(void *context, int status, struct kiln_error *error)
{
    (void)context, (void)error;
    return status;
}

static int sum_alone(void *context, int status, uint64_t *values, uint64_t *before, size_t count,
                     struct kiln_error *error)
{
    (void)context, (void)values, (void)error;
    if (status == KILN_OK && before != NULL)
        memset(before, 0, count * sizeof *before);
    return status;
}

static int allgather_alone(void *context, int status, const void *own, size_t count, size_t size,
                           kiln_surface_taker take, void *taker, struct kiln_error *error)
{
    (void)context, (void)size, (void)error;
    if (status == KILN_OK && count > 0)
        take(taker, own, count);
    return status;
}

static int alltoall_alone(void *context, int status, const void *own, const size_t *counts, size_t size,
                          kiln_surface_taker take, void *taker, struct kiln_error *error)
{
    (void)context, (void)own, (void)counts, (void)size, (void)take, (void)taker, (void)error;
    return status;
}

static const struct kiln_surface_exchange alone = {
    .agree = agree_alone, .sum = sum_alone, .allgather = allgather_alone, .alltoall = alltoall_alone};

/* ---- building ---- */

/* Counts the points on backs. Tiles of lightmaps of backs come after those of all fronts. */
static uint64_t count_back_points(const struct kiln_surface *s)
{
    uint64_t count = 0;
    const uint32_t fronts = kiln_front_maps(s);
    const uint64_t first = s->map_count > fronts ? s->lightmaps[fronts].tile_first : s->tile_count;
    for (uint64_t t = first; t < s->tile_count; t++)
        count += (uint64_t)__builtin_popcountll(s->tiles[t].mask);
    return count;
}

static void release(struct kiln_build *build)
{
    if (build->tile_ranges != NULL) {
        const uint64_t count = build->map_range[build->surface->map_count];
        for (uint64_t b = 0; b < count; b++)
            kiln_free(&build->tile_ranges[b].runs);
    }
    kiln_free(&build->tile_ranges);
    kiln_free(&build->map_range);
    kiln_free(&build->object_area);
    kiln_free(&build->vertex_chart);
    kiln_free(&build->cell_codes);
    kiln_free(&build->units.points);
    kiln_free(&build->units.first_point);
    kiln_free(&build->units.first_tile_run);
}

static int find_tile_runs(struct kiln_build *build, int status)
{
    status = build->exchange->agree(build->exchange->context, status, build->error);
    if (status == KILN_OK)
        status = kiln_build_measure(build);
    if (status == KILN_OK)
        status = kiln_build_cover(build);
    if (status == KILN_OK)
        status = kiln_build_order(build);
    if (status == KILN_OK)
        status = kiln_build_assign(build);
    return status;
}

int kiln_surface_build(struct kiln_surface **surface, const struct kiln_surface_params *params,
                       struct kiln_surface_report *report, struct kiln_error *error)
{
    *surface = NULL;
    *report = (struct kiln_surface_report){0};
    struct kiln_build build = {.params = params,
                               .exchange = params->exchange != NULL ? params->exchange : &alone,
                               .workers = params->exchange != NULL ? params->ranks : 1,
                               .worker = params->exchange != NULL ? params->rank : 0,
                               .scene = params->scene,
                               .geometry = params->geometry,
                               .report = report,
                               .threads = params->threads > 0 ? params->threads : (uint32_t)omp_get_max_threads(),
                               .error = error};
    int status = params->rank < params->ranks
                     ? KILN_OK
                     : kiln_fail(error, KILN_USAGE,
                                 "there is no rank %u among %u ranks: give a rank from 0 to the number of ranks - 1",
                                 params->rank, params->ranks);
    if (status == KILN_OK)
        status = kiln_allocate(&build.surface, 1, sizeof *build.surface, "the surface", error);
    status = find_tile_runs(&build, status);
    if (status == KILN_OK) {
        report->cells_occupied = build.surface->cell_count;
        report->back_points = count_back_points(build.surface);
        report->cells_total = build.grid.count[0] * build.grid.count[1] * build.grid.count[2];
        report->cell_size = build.grid.size;
        for (int axis = 0; axis < 3; axis++)
            report->cells[axis] = build.grid.count[axis];
        release(&build); /* the surface has all that is needed from here on */
        status = kiln_build_fill(&build);
    }
    if (status == KILN_OK) {
        *surface = build.surface;
        build.surface = NULL;
    }
    release(&build);
    kiln_surface_destroy(&build.surface);
    return status;
}
