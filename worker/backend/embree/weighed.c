/* The weighed pass (worker/pass/weighed.h): the caustic pass, which shares its light with light paths. */
#include <math.h>
#include <string.h>

#include "worker/backend/embree/chain_weighed.h"
#include "worker/backend/embree/hemisphere.h"
#include "worker/backend/embree/mirror_images.h"
#include "worker/backend/embree/techniques.h"
#include "worker/backend/embree/tile_runs.h"
#include "worker/base/memory.h"

/* A thread's working set. */
struct weighed_work {
    struct hemisphere h;
    const struct kiln_caustic_techniques *techniques;
    double area[RAY_LANES]; /* m2 of each point that can be lit */
};

static void weighed_destroy(void **work)
{
    struct weighed_work *w = *work;
    if (w != NULL)
        hemisphere_release(&w->h);
    kiln_free(work);
}

static int weighed_create(void **work, const struct embree_backend *b, const void *parameters,
                          const struct kiln_batch *part, struct kiln_error *error)
{
    struct weighed_work *w = NULL;
    int status = kiln_allocate(&w, 1, sizeof *w, "the weighed pass", error);
    *work = w;
    if (status != KILN_OK)
        return status;
    w->techniques = parameters;
    status = hemisphere_create(&w->h, b, part, KILN_CAUSTIC_STREAM + part->stream, error);
    if (status == KILN_OK)
        status = hemisphere_ask_lights(&w->h, error);
    if (status != KILN_OK)
        weighed_destroy(work);
    return status;
}

/* The areas of the tile run's points. */
static void find_areas(struct weighed_work *w, const struct embree_backend *b, size_t tile_run)
{
    const struct tile_run_frame *frame = &w->h.rays->frame;
    const uint64_t first = kiln_own_of_global(b->surface, b->surface->tile_runs[tile_run].first).at;
    for (uint32_t j = 0; j < frame->count; j++) {
        const struct kiln_own_point own = {first + frame->place[j]};
        w->area[j] = kiln_lit_area(b->surface, own, frame->present[j]);
    }
}

/* Finds the light of lane l's chain. */
static void follow(struct weighed_work *w, uint32_t step, uint32_t l, float light[3])
{
    const struct tile_run_rays *r = w->h.rays;
    const struct RTCRayHit ray = rays_lane(r, l);
    const uint32_t j = r->point[l];
    const struct kiln_caustic_gathered sums = kiln_caustic_gather(w->area[j], (double)r->samples);
    chain_follow_weighed(&w->h.walk, w->techniques, &sums, r->chance[l], rays_sample(r, step, l), &ray, light);
}

/* Adds light of lamps and sky found by chains, as radiosity. Rays that hit nothing glossy contribute nothing. */
static void collect(const struct embree_backend *b, struct embree_context *context, struct weighed_work *w,
                    uint32_t step, uint32_t lanes)
{
    const struct tile_run_rays *r = w->h.rays;
    w->h.walk.context = context;
    for (uint32_t l = 0; l < lanes; l++) {
        float rgb[3], luminance;
        if (!hemisphere_is_chain(b, r, l))
            continue;
        follow(w, step, l, rgb);
        for (int c = 0; c < 3; c++)
            rgb[c] *= (float)KILN_PI;
        (void)hemisphere_add(&w->h, l, rays_quarter(r, step, l), rgb, embree_tints(b), &luminance);
    }
}

/* Adds the light of lamps' images in flat mirrors. `error`: standard error of a point's sum. */
static void add_images(struct weighed_work *w, struct embree_context *context, double error[RAY_LANES])
{
    const double samples = (double)w->h.rays->samples;
    w->h.walk.context = context;
    for (uint32_t j = 0; j < w->h.rays->frame.count; j++) {
        struct image_light light;
        images_light(&w->h.walk, w->techniques->images, w->h.rays, j, &light);
        for (int c = 0; c < 3; c++) {
            w->h.incident[j][c] += samples * light.incident[c];
            w->h.irradiance[j][c] += samples * light.irradiance[c];
        }
        error[j] = samples * light.error;
    }
}

/* Stores the sums, then the light of images, which has errors of its own. */
static void store_with_images(struct weighed_work *w, struct embree_context *context, struct kiln_point_result *results)
{
    double error[RAY_LANES];
    add_images(w, context, error);
    hemisphere_store(&w->h, results, sizeof *results);
    for (uint32_t j = 0; j < w->h.rays->frame.count; j++) {
        struct kiln_point_result *r = &results[w->h.rays->frame.place[j]];
        r->error = hypotf(r->error, (float)error[j]);
    }
}

static void weighed_tile_run(void *work, const struct embree_backend *b, struct embree_context *context,
                             size_t tile_run, void *results, uint64_t *rays)
{
    struct weighed_work *w = work;
    const uint32_t steps = rays_begin(w->h.rays, b, tile_run, w->h.stream, 0);
    if (steps == 0)
        return;
    hemisphere_clear(&w->h);
    find_areas(w, b, tile_run);
    for (uint32_t step = 0; step < steps; step++) {
        const uint32_t lanes = rays_make(w->h.rays, b, step);
        *rays += lanes;
        rays_trace(w->h.rays, b, context, lanes);
        collect(b, context, w, step, lanes);
    }
    memset(w->h.glass, 0, sizeof w->h.glass); /* of what gather rays find */
    if (w->techniques->images != NULL)
        store_with_images(w, context, results);
    else
        hemisphere_store(&w->h, results, sizeof(struct kiln_point_result));
}

int embree_weighed(struct embree_backend *b, const void *parameters, const struct kiln_batch *part, void *results,
                   uint64_t *rays, struct kiln_error *error)
{
    static const struct tile_run_pass pass = {weighed_create, weighed_destroy, weighed_tile_run,
                                              sizeof(struct kiln_point_result)};
    return embree_each_tile_run(b, &pass, parameters, part, results, rays, error);
}
