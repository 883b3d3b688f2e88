/* The occlusion pass (worker/pass/occlusion.h): rays about the shading normals of a tile run's points. Each ray counts
 * as open or not. */
#include <math.h>
#include <string.h>

#include "shaders/shared/streams.h"
#include "worker/backend/embree/rays.h"
#include "worker/backend/embree/tile_runs.h"
#include "worker/base/memory.h"
#include "worker/pass/occlusion.h"

/* A thread's working set. */
struct occlusion_work {
    struct tile_run_rays *rays;
    /* sums of a point: open rays of each quarter of the samples, and their directions */
    uint32_t open[RAY_QUARTERS][RAY_LANES];
    double direction[3][RAY_LANES];
};

static void work_destroy(void **work)
{
    struct occlusion_work *w = *work;
    if (w != NULL)
        rays_destroy(&w->rays);
    kiln_free(work);
}

static int work_create(void **work, const struct embree_backend *b, const void *parameters,
                       const struct kiln_batch *part, struct kiln_error *error)
{
    (void)b;
    const struct kiln_occlusion_parameters *p = parameters;
    struct occlusion_work *w = NULL;
    int status = kiln_allocate(&w, 1, sizeof *w, "the occlusion pass", error);
    *work = w;
    if (status == KILN_OK)
        status = rays_create(&w->rays, RAYS_SHADING, (float)p->distance, part, error);
    if (status != KILN_OK)
        work_destroy(work);
    return status;
}

/* Whether a direction is above the surface: those about a shading normal may not be, unless rays are lifted. */
static bool is_above(const struct tile_run_rays *r, uint32_t l)
{
    return !r->frame.smooth || r->frame.lifted[r->point[l]] ||
           r->facet[0][l] * r->direction[0][l] + r->facet[1][l] * r->direction[1][l] +
                   r->facet[2][l] * r->direction[2][l] >
               0.0f;
}

static void collect(struct occlusion_work *w, uint32_t step, uint32_t lanes)
{
    const struct tile_run_rays *r = w->rays;
    for (uint32_t l = 0; l < lanes; l++) {
        const uint32_t j = r->point[l];
        if (rays_is_blocked(r, l) || !is_above(r, l))
            continue;
        w->open[r->quarter_of[step * r->copies + r->copy[l]]][j]++;
        for (int c = 0; c < 3; c++)
            w->direction[c][j] += (double)r->direction[c][l];
    }
}

/* Standard error of the number of open rays, from its spread over the four quarters of the samples. */
static float quarters_error(const struct occlusion_work *w, uint32_t j, double open)
{
    const uint32_t samples = w->rays->samples;
    if (samples < RAY_QUARTERS)
        return 0.0f;
    double square = 0.0;
    for (uint32_t q = 0; q < RAY_QUARTERS; q++) {
        const uint32_t count = kiln_quarter_first(q + 1, samples) - kiln_quarter_first(q, samples);
        const double off = (double)w->open[q][j] / count - open;
        square += off * off;
    }
    return (float)(samples * sqrt(square / (RAY_QUARTERS * (RAY_QUARTERS - 1))));
}

static void store(const struct occlusion_work *w, struct kiln_occlusion_result *results)
{
    const uint32_t samples = w->rays->samples;
    for (uint32_t j = 0; j < w->rays->frame.count; j++) {
        struct kiln_occlusion_result *r = &results[w->rays->frame.place[j]];
        uint32_t open = 0;
        for (int q = 0; q < RAY_QUARTERS; q++)
            open += w->open[q][j];
        r->open = (float)open;
        for (int c = 0; c < 3; c++) /* rounding of a single direction may exceed 1 */
            r->direction[c] = fmaxf(-(float)samples, fminf((float)w->direction[c][j], (float)samples));
        r->error = quarters_error(w, j, (double)open / samples);
        r->count = samples;
    }
}

static void occlusion_tile_run(void *work, const struct embree_backend *b, struct embree_context *context,
                               size_t tile_run, void *results, uint64_t *rays)
{
    struct occlusion_work *w = work;
    const uint32_t steps = rays_begin(w->rays, b, tile_run, KILN_OCCLUSION_STREAM, 0);
    memset(w->open, 0, sizeof w->open);
    memset(w->direction, 0, sizeof w->direction);
    for (uint32_t step = 0; step < steps; step++) {
        const uint32_t lanes = rays_make(w->rays, b, step);
        rays_block(w->rays, b, context, lanes);
        collect(w, step, lanes);
        *rays += lanes;
    }
    store(w, results);
}

int embree_occlusion(struct embree_backend *b, const void *parameters, const struct kiln_batch *part, void *results,
                     uint64_t *rays, struct kiln_error *error)
{
    static const struct tile_run_pass pass = {work_create, work_destroy, occlusion_tile_run,
                                              sizeof(struct kiln_occlusion_result)};
    return embree_each_tile_run(b, &pass, parameters, part, results, rays, error);
}
