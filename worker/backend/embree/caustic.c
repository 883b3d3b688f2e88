/* The caustic pass (worker/pass/caustic.h): rays that find light of lamps and sky by chains of gloss. */
#include "worker/pass/caustic.h"

#include <string.h>

#include "worker/backend/embree/hemisphere.h"
#include "worker/backend/embree/tile_runs.h"
#include "worker/base/memory.h"

static void caustic_destroy(void **work)
{
    if (*work != NULL)
        hemisphere_release(*work);
    kiln_free(work);
}

static int caustic_create(void **work, const struct embree_backend *b, const void *parameters,
                          const struct kiln_batch *part, struct kiln_error *error)
{
    (void)parameters;
    struct hemisphere *h = NULL;
    int status = kiln_allocate(&h, 1, sizeof *h, "the caustic pass", error);
    *work = h;
    if (status == KILN_OK)
        status = hemisphere_create(h, b, part, KILN_CAUSTIC_STREAM + part->stream, error);
    if (status == KILN_OK)
        status = hemisphere_ask_lights(h, error);
    if (status != KILN_OK)
        caustic_destroy(work);
    return status;
}

/* Adds light of lamps and sky found by chains, as radiosity. Rays that hit nothing glossy contribute nothing. */
static void collect(const struct embree_backend *b, struct embree_context *context, struct hemisphere *h, uint32_t step,
                    uint32_t lanes)
{
    const struct tile_run_rays *r = h->rays;
    h->walk.context = context;
    for (uint32_t l = 0; l < lanes; l++) {
        float rgb[3], luminance;
        if (!hemisphere_is_chain(b, r, l))
            continue;
        hemisphere_follow(h, step, l, false);
        for (int c = 0; c < 3; c++)
            rgb[c] = h->chain.light[c] * (float)KILN_PI;
        (void)hemisphere_add(h, l, rays_quarter(r, step, l), rgb, embree_tints(b), &luminance);
    }
}

static void caustic_tile_run(void *work, const struct embree_backend *b, struct embree_context *context,
                             size_t tile_run, void *results, uint64_t *rays)
{
    struct hemisphere *h = work;
    const uint32_t steps = rays_begin(h->rays, b, tile_run, h->stream, 0);
    if (steps == 0)
        return;
    hemisphere_clear(h);
    for (uint32_t step = 0; step < steps; step++) {
        const uint32_t lanes = rays_make(h->rays, b, step);
        *rays += lanes;
        rays_trace(h->rays, b, context, lanes);
        collect(b, context, h, step, lanes);
    }
    memset(h->glass, 0, sizeof h->glass); /* of what gather rays find */
    hemisphere_store(h, results, sizeof(struct kiln_point_result));
}

int embree_caustic(struct embree_backend *b, const void *parameters, const struct kiln_batch *part, void *results,
                   uint64_t *rays, struct kiln_error *error)
{
    static const struct tile_run_pass pass = {caustic_create, caustic_destroy, caustic_tile_run,
                                              sizeof(struct kiln_point_result)};
    return embree_each_tile_run(b, &pass, parameters, part, results, rays, error);
}
