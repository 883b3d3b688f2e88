#include "coordinator/integrate/land/land_state.h"

#include <math.h>

#include "worker/pass/caustic.h"
#include "worker/sampling/keys.h"

float kiln_landing_presence(const struct kiln_landing *l, const struct kiln_surface *surface,
                            const struct kiln_point_cursor *at)
{
    const struct kiln_backend_params *b = &l->params->backend->params;
    const uint64_t texel = (uint64_t)at->y * surface->lightmaps[at->map].width + at->x;
    struct kiln_footprint footprint;
    struct kiln_mask mask;
    if (b->geometry->opaque_count == b->geometry->triangle_count)
        return 1.0f;
    kiln_footprint_prepare(&footprint, b->scene, b->geometry, surface, at);
    return kiln_footprint_opacity(&footprint, kiln_texel_key(KILN_LOOKS_KEY, at->map, texel), &mask);
}

bool kiln_landing_is_receiver(const struct kiln_landing *l, size_t tile_run)
{
    const struct kiln_surface *s = &l->solution->own->surface;
    const uint32_t object = kiln_map_object(s, s->tile_runs[tile_run].map);
    return (l->params->backend->params.scene->objects[object].flags & KILN_OBJECT_RECEIVER_ONLY) != 0;
}

size_t kiln_landing_same_kind(const struct kiln_landing *l, size_t first, size_t end)
{
    size_t next = first + 1;
    while (next < end && kiln_landing_is_receiver(l, next) == kiln_landing_is_receiver(l, first))
        next++;
    return next;
}

static struct kiln_point_result answer(const struct kiln_landing *l, const struct kiln_surface *surface,
                                       const struct kiln_point_cursor *at)
{
    static const struct kiln_landing_sum none = {.count = 0};
    const struct kiln_landing_sum *sum = l->sums != NULL ? &l->sums[at->point.at] : &none;
    struct kiln_point_result r = {.present = 1.0f, .count = 1};
    if (!kiln_point_valid(surface, at->point))
        return (struct kiln_point_result){.count = 0};
    r.present = kiln_landing_presence(l, surface, at);
    const double area = kiln_lit_area(surface, at->point, r.present),
                 scale = area > 0.0 ? 1.0 / (area * (double)kiln_landing_iterations(l)) : 0.0;
    for (int c = 0; c < 3; c++) {
        r.irradiance[c] = (float)(sum->irradiance[c] * scale);
        r.incident[c] = (float)(sum->incident[c] * scale);
    }
    r.error = (float)(sqrt(sum->square) * scale);
    return r;
}

/* Returns the answer of a point after its light was spread (merged). If gather rays are spread too, the answer counts
 * the rays of the step. */
static struct kiln_point_result merged_answer(const struct kiln_landing *l, const struct kiln_surface *surface,
                                              const struct kiln_point_cursor *at)
{
    const struct kiln_merged *merged = &l->merged[at->point.at];
    const uint64_t iterations = kiln_landing_iterations(l);
    struct kiln_point_result r = {.count = kiln_landing_spreads_rays(l) ? kiln_landing_own_rays(l) : 1};
    const double count = (double)r.count;
    if (!kiln_point_valid(surface, at->point))
        return (struct kiln_point_result){.count = 0};
    r.present = kiln_landing_presence(l, surface, at);
    for (int c = 0; c < 3; c++) {
        r.irradiance[c] = (float)(count * merged->irradiance[c] / (double)iterations);
        r.incident[c] = (float)(count * merged->incident[c] / (double)iterations);
    }
    r.error = (float)(count * kiln_merge_error(merged, iterations));
    return r;
}

/* Gathers caustics of tile runs that no light path can meet. */
static int gather(struct kiln_landing *l, const struct kiln_batch *batch, size_t first, size_t end,
                  struct kiln_error *error)
{
    struct kiln_batch part = *batch;
    part.first = first;
    part.count = end - first;
    return kiln_backend_run(l->params->backend, &kiln_pass_caustic, NULL, &part, &kiln_solution_step(l->solution)->rays,
                            error);
}

static int give(struct kiln_landing *l, const struct kiln_batch *batch, size_t first, size_t end,
                struct kiln_error *error)
{
    const struct kiln_surface *surface = &l->solution->own->surface;
    const struct kiln_tile_run *runs = surface->tile_runs;
    const bool merged = (kiln_landing_merges(l) || kiln_landing_spreads_rays(l)) && !kiln_land_trial_leaves_out(l);
    const bool counts = kiln_landing_spreads_rays(l) && merged;
    uint64_t rays = 0;
#pragma omp parallel for num_threads((int)l->params->threads) schedule(static) reduction(+ : rays)
    for (size_t f = first; f < end; f++) {
        struct kiln_point_cursor at = kiln_point_first(surface, f);
        struct kiln_point_result *r = &l->results[runs[f].first.at - runs[first].first.at];
        for (uint32_t k = 0; k < runs[f].count; k++, r++, kiln_point_next(surface, &at)) {
            *r = merged ? merged_answer(l, surface, &at) : answer(l, surface, &at);
            rays += counts ? r->count : 0;
        }
    }
    kiln_solution_step(l->solution)->rays += rays;
    return batch->take(batch->context, first, end - first, l->results, error);
}

/* Adds the light that has landed at a point to what was gathered there. */
static void combine(const struct kiln_point_result *landed, struct kiln_point_result *r)
{
    const float n = (float)r->count;
    for (int c = 0; c < 3; c++) {
        r->irradiance[c] += n * landed->irradiance[c];
        r->incident[c] += n * landed->incident[c];
    }
    r->error = hypotf(r->error, n * landed->error);
}

/* Context of a batch whose gather rays find a part of the light that is not spread. */
struct gathered {
    struct kiln_landing *landing;
    const struct kiln_batch *batch;
};

/* kiln_take_results */
static int take_gathered(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    const struct gathered *g = context;
    struct kiln_landing *l = g->landing;
    const struct kiln_surface *surface = &l->solution->own->surface;
    const struct kiln_point_result *next = results;
    int status = KILN_OK;
    for (size_t end = first + count, stop; first < end && status == KILN_OK; first = stop) {
        size_t points = 0;
        stop = end - first < KILN_LANDING_GIVEN_TILE_RUNS ? end : first + KILN_LANDING_GIVEN_TILE_RUNS;
        for (size_t f = first; f < stop; f++) {
            struct kiln_point_cursor at = kiln_point_first(surface, f);
            for (uint32_t k = 0; k < surface->tile_runs[f].count; k++, kiln_point_next(surface, &at)) {
                const struct kiln_point_result landed = answer(l, surface, &at);
                l->results[points] = *next++;
                combine(&landed, &l->results[points++]);
            }
        }
        status = g->batch->take(g->batch->context, first, stop - first, l->results, error);
    }
    return status;
}

/* Traces gather rays of tile runs, for the light that light paths leave to them. */
static int give_gathered(struct kiln_landing *l, const struct kiln_batch *batch, size_t first, size_t end,
                         struct kiln_error *error)
{
    struct gathered g = {l, batch};
    struct kiln_batch rays = kiln_batch_taken_by(batch, take_gathered, &g);
    rays.first = first;
    rays.count = end - first;
    rays.samples = kiln_landing_own_rays(l);
    rays.first_sample = kiln_landing_first_ray(l);
    return kiln_landing_run_pass(l, &kiln_pass_weighed, &l->techniques, &rays, &kiln_solution_step(l->solution)->rays,
                                 error);
}

int kiln_landing_give(struct kiln_landing *l, const struct kiln_batch *batch, struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t first = batch->first, end = batch->first + batch->count, next; first < end && status == KILN_OK;
         first = next) {
        const bool none = kiln_land_trial_leaves_out(l), receiver = !none && kiln_landing_is_receiver(l, first),
                   rays = !none && !receiver && kiln_landing_gathers(l) && !kiln_landing_spreads(l->params->settings);
        const size_t most =
            receiver || rays || end - first < KILN_LANDING_GIVEN_TILE_RUNS ? end : first + KILN_LANDING_GIVEN_TILE_RUNS;
        next = kiln_landing_same_kind(l, first, most);
        status = receiver ? gather(l, batch, first, next, error)
                 : rays   ? give_gathered(l, batch, first, next, error)
                          : give(l, batch, first, next, error);
    }
    return status;
}
