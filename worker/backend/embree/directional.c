/* The directional pass (worker/pass/directional.h): rays evenly distributed over the hemispheres of a tile run's
 * points, for light of surfaces and a constant sky; shadow rays for the lights. */
#include <math.h>
#include <string.h>

#include "shaders/shared/streams.h"
#include "worker/backend/embree/chain.h"
#include "worker/backend/embree/light_samples.h"
#include "worker/backend/embree/lookup.h"
#include "worker/backend/embree/rays.h"
#include "worker/backend/embree/shadow.h"
#include "worker/backend/embree/tile_runs.h"
#include "worker/base/memory.h"
#include "worker/pass/directional.h"
#include "worker/sampling/harmonics.h"

/* L_lm of a point. */
struct directional_sums {
    double radiance[KILN_DIRECTIONAL_HARMONICS][3];
};

/* Working set of a thread. A point's sums are added up in the order of its samples, whatever the number of lanes,
 * separately for surfaces, the sky, and lights. */
struct directional_work {
    struct tile_run_rays *rays;
    struct rays_found found;
    struct kiln_light_choice *choices;
    struct directional_sums surfaces[RAY_LANES], sky[RAY_LANES];
};

static void work_destroy(void **work)
{
    struct directional_work *w = *work;
    if (w != NULL) {
        rays_destroy(&w->rays);
        kiln_free(&w->choices);
    }
    kiln_free(work);
}

static int work_create(void **work, const struct embree_backend *b, const void *parameters,
                       const struct kiln_batch *part, struct kiln_error *error)
{
    (void)parameters;
    struct directional_work *w = NULL;
    int status = kiln_allocate(&w, 1, sizeof *w, "the directional pass", error);
    *work = w;
    if (status == KILN_OK)
        status = rays_create(&w->rays, RAYS_UNIFORM, INFINITY, part, error);
    if (status == KILN_OK)
        status = kiln_allocate(&w->choices, light_choices_room(b->params.lights), sizeof *w->choices,
                               "the light choices", error);
    if (status != KILN_OK)
        work_destroy(work);
    return status;
}

/* Adds radiance x solid angle `value` that arrives from direction d. */
static void add(struct directional_sums *sums, struct kiln_dvec3 d, const double value[3])
{
    double y[KILN_HARMONICS];
    kiln_harmonics(d, y);
    for (int i = 0; i < KILN_DIRECTIONAL_HARMONICS; i++)
        for (int c = 0; c < 3; c++)
            sums->radiance[i][c] += y[i] * value[c];
}

/* Adds the radiance that a lane's ray brings. */
static void add_lane(struct directional_sums *sums, const struct embree_backend *b, const struct tile_run_rays *r,
                     uint32_t lane, const float radiance[3])
{
    const double solid_angle = 2.0 * KILN_PI / r->samples;
    const bool tints = embree_tints(b);
    double value[3];
    for (int c = 0; c < 3; c++)
        value[c] = (double)(tints ? radiance[c] * r->tint[lane][c] : radiance[c]) * solid_angle;
    add(&sums[r->point[lane]],
        dvec3((double)r->direction[0][lane], (double)r->direction[1][lane], (double)r->direction[2][lane]), value);
}

/* Adds what hit i of the rays sends. */
static void add_hit(struct directional_work *w, const struct embree_backend *b, uint32_t i)
{
    float rgb[3];
    if (w->found.point[i] == KILN_NO_POINT)
        return;
    kiln_radiosity_unpack(b->radiosity[w->found.point[i]], rgb);
    for (int c = 0; c < 3; c++)
        rgb[c] *= KILN_INVERSE_PI;
    add_lane(w->surfaces, b, w->rays, w->found.lane[i], rgb);
}

/* Adds the light that lane l's chain finds: of diffuse surfaces, lamps and sky. */
static void add_chain(struct directional_work *w, struct walk *walk, uint32_t step, uint32_t l)
{
    const struct tile_run_rays *r = w->rays;
    const struct RTCRayHit ray = rays_lane(r, l);
    struct chain_found found;
    float rgb[3];
    chain_follow(walk, r->chance[l], rays_sample(r, step, l), &ray, true, &found);
    for (int c = 0; c < 3; c++)
        rgb[c] = found.radiosity[c] * KILN_INVERSE_PI + found.light[c];
    add_lane(w->surfaces, walk->b, r, l, rgb);
}

/* Adds the light of surfaces, lane by lane, where rays continue in chains. */
static void add_surfaces(struct directional_work *w, struct walk *walk, uint32_t step, uint32_t lanes)
{
    const struct rays_found *found = &w->found;
    for (uint32_t l = 0, hit = 0; l < lanes; l++) {
        const bool is_hit = hit < found->count && found->lane[hit] == l;
        if (chain_begins_at(walk->b, w->rays, l))
            add_chain(w, walk, step, l);
        else if (is_hit)
            add_hit(w, walk->b, hit);
        hit += is_hit;
    }
}

static void collect(struct directional_work *w, const struct embree_backend *b, struct embree_context *context,
                    uint32_t step, uint32_t lanes)
{
    const struct kiln_lights *lights = b->params.lights;
    const struct rays_found *found = &w->found;
    struct walk walk = {.b = b, .context = context, .choices = w->choices};
    if (chain_any(b))
        add_surfaces(w, &walk, step, lanes);
    for (uint32_t i = 0; i < found->count && !chain_any(b); i++)
        add_hit(w, b, i);
    for (uint32_t i = 0; i < found->escaped && light_sky_is_constant(lights); i++) {
        float sky[3];
        kiln_environment_radiance(lights, dvec3(0.0, 0.0, 1.0), sky); /* the same from everywhere */
        add_lane(w->sky, b, w->rays, found->escaped_lane[i], sky);
    }
}

/* One sample of a light at point j. Returns its rays. */
static uint64_t add_light(struct directional_sums *sums, struct tile_run_rays *r, const struct embree_backend *b,
                          struct embree_context *context, uint32_t j, const struct kiln_light_choice *choice,
                          uint32_t identity, uint32_t k)
{
    struct kiln_vec3 start, n;
    struct kiln_light_sample sample;
    const float offset = rays_place(r, b, j, k, &start, &n);
    const struct kiln_dvec3 normal = dvec3_of(n),
                            place = dvec3_sub(dvec3_of(start), dvec3_scale(normal, (double)offset));
    if (!light_draw(b->params.lights, choice, identity, k, place, &sample) ||
        !(dvec3_dot(normal, sample.direction) > 0.0))
        return 0;
    const struct kiln_dvec3 direction = sample.direction;
    shadow_aim(&sample, place, dvec3_of(start));
    if (light_arrives(b, context, start, choice, &sample))
        add(sums, direction, sample.value);
    return 1;
}

/* Adds the light of lamps at point j, by shadow rays; rays over the hemisphere find a constant sky. */
static uint64_t add_lights(struct directional_sums *sums, struct directional_work *w, const struct embree_backend *b,
                           struct embree_context *context, uint32_t j)
{
    const struct tile_run_frame *f = &w->rays->frame;
    const uint32_t samples = w->rays->samples;
    const uint32_t key = kiln_hash2(f->key[j], KILN_DIRECTIONAL_STREAM);
    const size_t count = light_choose(b->params.lights, dvec3_of(f->extent[j].centre), (double)f->extent[j].spread,
                                      frame_one_normal(f, j), kiln_cut_limit(samples), samples, w->choices);
    uint64_t rays = 0;
    for (size_t i = 0; i < count; i++) {
        const uint32_t identity = light_identity(key, &w->choices[i]);
        for (uint32_t k = 0; k < w->choices[i].samples; k++)
            rays += add_light(sums, w->rays, b, context, j, &w->choices[i], identity, k);
    }
    return rays;
}

static void store(const struct directional_work *w, uint32_t j, const struct directional_sums *lights,
                  struct kiln_directional_result *result)
{
    const uint32_t samples = w->rays->samples;
    for (int i = 0; i < KILN_DIRECTIONAL_HARMONICS; i++)
        for (int c = 0; c < 3; c++)
            result->radiance[i][c] =
                (float)(samples * (w->surfaces[j].radiance[i][c] + w->sky[j].radiance[i][c] + lights->radiance[i][c]));
    result->count = samples;
}

static void directional_tile_run(void *work, const struct embree_backend *b, struct embree_context *context,
                                 size_t tile_run, void *results, uint64_t *rays)
{
    struct directional_work *w = work;
    struct kiln_directional_result *points = results;
    const uint32_t steps = rays_begin(w->rays, b, tile_run, KILN_DIRECTIONAL_STREAM, FRAME_EXTENT);
    memset(w->surfaces, 0, sizeof w->surfaces);
    memset(w->sky, 0, sizeof w->sky);
    for (uint32_t step = 0; step < steps; step++) {
        const uint32_t lanes = rays_make(w->rays, b, step);
        rays_trace(w->rays, b, context, lanes);
        embree_find(b, w->rays, lanes, &w->found);
        collect(w, b, context, step, lanes);
        *rays += lanes;
    }
    for (uint32_t j = 0; j < w->rays->frame.count; j++) {
        struct directional_sums lights = {0};
        *rays += add_lights(&lights, w, b, context, j);
        store(w, j, &lights, &points[w->rays->frame.place[j]]);
    }
}

int embree_directional(struct embree_backend *b, const void *parameters, const struct kiln_batch *part, void *results,
                       uint64_t *rays, struct kiln_error *error)
{
    static const struct tile_run_pass pass = {work_create, work_destroy, directional_tile_run,
                                              sizeof(struct kiln_directional_result)};
    return embree_each_tile_run(b, &pass, parameters, part, results, rays, error);
}
