/* The path pass (worker/pass/path.h): one path after the other, ray by ray. shaders/path.glsl follows the same paths.
 */
#include <math.h>
#include <omp.h>
#include <string.h>

#include "shaders/shared/color.h"
#include "shaders/shared/warp.h"
#include "worker/backend/embree/camera_ray.h"
#include "worker/backend/embree/chain.h"
#include "worker/backend/embree/light_samples.h"
#include "worker/backend/embree/path.h"
#include "worker/base/memory.h"
#include "worker/pass/path.h"
#include "worker/scene/footprint.h"
#include "worker/scene/texture.h"

/* A path under way. */
struct path {
    struct walk walk; /* its key is the pixel's */
    const struct kiln_path_parameters *camera;
    float weight[3]; /* weight of incoming radiance at the camera, by colour */
    float seen[3];   /* weight for the next surface's emission: 0 if light samples have accounted for it */
    float radiance[3];
    uint32_t bounces, chain; /* diffuse events so far; other surfaces since the last one */
    /* for a path from a surface point, which counts as its first diffuse surface: the light with the largest number of
     * bounces; else NULL. Light that then reaches the last diffuse surface only by mirrors, gloss and glass counts
     * here, but not for cameras */
    float *last;
};

static void multiply(struct path *p, const float factor[3])
{
    for (int c = 0; c < 3; c++) {
        p->weight[c] *= factor[c];
        p->seen[c] *= factor[c];
    }
}

/* ---- rays ---- */

/* Traces the ray to surface number `surface`; false: no hit. */
static bool trace(struct path *p, struct kiln_vec3 origin, struct kiln_vec3 direction, uint32_t surface,
                  struct RTCRayHit *ray)
{
    float tint[3] = {1.0f, 1.0f, 1.0f};
    const bool meets = walk_trace(&p->walk, origin, direction, kiln_path_use(surface, KILN_PATH_CHANCE), tint, ray);
    multiply(p, tint);
    return meets;
}

/* Finds the surface that the camera sees along the ray. False: only the environment. */
static bool look(struct path *p, struct kiln_vec3 origin, struct kiln_vec3 direction, struct RTCRayHit *ray)
{
    p->walk.rays++;
    for (uint32_t i = 0; i <= KILN_PATH_UNSEEN; i++) {
        if (!trace(p, origin, direction, 0, ray))
            return false;
        if (meeting_is_seen(p->walk.b, embree_triangle(p->walk.b, ray->hit.geomID, ray->hit.primID),
                            meeting_is_back(ray)))
            return true;
        origin = vec3_madd(origin, direction, kiln_path_beyond(ray->ray.tfar, p->walk.b->params.geometry->extent));
    }
    return false;
}

/* ---- surfaces ---- */

/* Attenuates the light in the body that the ray has crossed, if it hits the body's surface from within. */
static void attenuate(struct path *p, const struct meeting *m, float distance)
{
    float share[3];
    if (meeting_attenuation(m, distance, share))
        multiply(p, share);
}

/* ---- paths from surface points ---- */

/* Whether the path has as many diffuse events as light may have: from then on only lights seen by mirrors, gloss and
 * glass count. */
static bool is_over(const struct path *p) { return p->last != NULL && p->bounces > p->camera->bounces; }

/* The sum for light that no further diffuse surface reflects. */
static float *sum_of(struct path *p) { return is_over(p) ? p->last : p->radiance; }

/* Adds the light, directly from lights, that the surface scatters along the path. */
static void add_lights(struct path *p, const struct meeting *m, uint32_t surface)
{
    if (p->last == NULL || p->bounces < p->camera->bounces) {
        walk_lights(&p->walk, m, surface, KILN_LOBE_ALL, p->weight, p->radiance);
        return;
    }
    if (!is_over(p)) /* light of the diffuse part has the largest number of bounces */
        walk_lights(&p->walk, m, surface, m->gloss != NULL ? KILN_LOBE_DIFFUSE : KILN_LOBE_ALL, p->weight, p->last);
    if (m->gloss != NULL)
        walk_lights(&p->walk, m, surface, m->others, p->weight, sum_of(p));
}

/* Multiplies the weight by the surface's colour; false: it is black. */
static bool reflect(struct path *p, const struct meeting *m, bool first)
{
    float color[4];
    if (m->gloss != NULL)
        return true;
    (first ? kiln_surface_base_color : kiln_surface_color)(p->walk.b->params.scene, m->mesh, m->stored, m->b1, m->b2,
                                                           color);
    for (int c = 0; c < 3; c++)
        p->weight[c] *= color[c];
    return p->weight[0] > 0.0f || p->weight[1] > 0.0f || p->weight[2] > 0.0f;
}

/* ---- the way on ---- */

/* Cosine-distributed direction about the axis; `cosine`: its cosine to the axis. */
static struct kiln_vec3 cosine_direction(struct kiln_vec3 axis, double u, double v, float *cosine)
{
    struct kiln_vec3 s, t;
    const float radius = (float)sqrt(u), turn = (float)(2.0 * KILN_PI * v);
    kiln_basis(axis, &s, &t);
    *cosine = (float)sqrt(1.0 - u);
    return vec3_madd(vec3_madd(vec3_scale(axis, *cosine), s, radius * cosf(turn)), t, radius * sinf(turn));
}

/* Draws a direction at a surface that is not only diffuse. Chooses at random between the diffuse part and the other
 * lobes, so that bounces can be counted. */
static bool turn_by_lobes(struct path *p, const struct meeting *m, uint32_t surface, struct kiln_vec3 *direction,
                          bool *diffuse)
{
    double u, v, pick, rest;
    float sharp[3], weight[3];
    walk_draw(&p->walk, kiln_path_use(surface, KILN_PATH_BOUNCE), &u, &v);
    walk_draw(&p->walk, kiln_path_use(surface, KILN_PATH_LOBE), &pick, &rest);
    const float chance = kiln_bsdf_choice_of(m->shares, KILN_LOBE_ALL).diffuse;
    *diffuse = pick < (double)chance;
    const bool sends = meeting_send(m, *diffuse ? KILN_LOBE_DIFFUSE : m->others, (float)rest, (float)u, (float)v,
                                    direction, weight, sharp);
    const float one = 1.0f / (*diffuse ? chance : 1.0f - chance);
    for (int c = 0; c < 3; c++) {
        p->seen[c] = p->weight[c] * sharp[c];
        weight[c] *= one;
    }
    multiply(p, weight);
    return sends && (p->weight[0] > 0.0f || p->weight[1] > 0.0f || p->weight[2] > 0.0f);
}

/* Draws the continuing direction, weighted as in the gather pass; false: it contributes nothing. */
static bool turn(struct path *p, const struct meeting *m, uint32_t surface, struct kiln_vec3 *direction, bool *diffuse)
{
    double u, v;
    float cosine;
    *diffuse = true;
    if (m->gloss != NULL)
        return turn_by_lobes(p, m, surface, direction, diffuse);
    walk_draw(&p->walk, kiln_path_use(surface, KILN_PATH_BOUNCE), &u, &v);
    const struct kiln_vec3 both = vec3_add(m->normal, m->shading); /* twice the normal but for smooth meshes */
    *direction = cosine_direction(vec3_normalize(both), u, v, &cosine);
    const float weight = kiln_shading_weight(vec3_dot(m->shading, *direction), cosine);
    for (int c = 0; c < 3; c++) {
        p->weight[c] *= weight;
        p->seen[c] = 0.0f;
    }
    return weight > 0.0f && (m->lifted || vec3_dot(m->normal, *direction) > 0.0f);
}

/* Russian roulette at surface number `surface`, for paths without a limit of bounces, or between mirrors. */
static bool survives(struct path *p, uint32_t surface)
{
    double u, v;
    const bool endless = p->camera->bounces == KILN_PATH_ALL_BOUNCES || p->chain >= KILN_PATH_CHAIN;
    if (!endless || surface < KILN_PATH_CERTAIN)
        return true;
    const float chance = kiln_path_chance(p->weight[0], p->weight[1], p->weight[2]);
    walk_draw(&p->walk, kiln_path_use(surface, KILN_PATH_END), &u, &v);
    for (int c = 0; c < 3; c++)
        p->weight[c] /= chance;
    return u < (double)chance;
}

/* Traces from surface number `surface` to the next; false: the path ends. */
static bool go_on(struct path *p, const struct meeting *m, uint32_t surface, struct RTCRayHit *ray)
{
    const bool sky = light_sky_is_constant(p->walk.b->params.lights), chains = p->last != NULL && chain_any(p->walk.b),
               may_end = m->gloss == NULL && !sky && !chains;
    struct kiln_vec3 direction;
    bool diffuse;
    if ((may_end && p->bounces == p->camera->bounces) || !survives(p, surface) ||
        !turn(p, m, surface, &direction, &diffuse))
        return false;
    const bool last = diffuse && p->bounces == p->camera->bounces;
    if ((last && !sky && !chains) || (diffuse && is_over(p)))
        return false;
    p->bounces += diffuse;
    p->chain = diffuse ? 0 : p->chain + 1;
    p->walk.rays++;
    const bool meets = trace(p, meeting_start(m, direction), direction, surface + 1, ray),
               arrives = meets && meeting_has_side(p->walk.b, meeting_record(p->walk.b, ray), meeting_is_back(ray));
    if (!meets)
        walk_environment(&p->walk, direction, sky ? p->weight : p->seen, sum_of(p));
    return arrives && (!last || (chains && chain_begins(p->walk.b, ray)));
}

/* ---- paths ---- */

static void camera_ray(const struct path *p, uint64_t pixel, struct kiln_vec3 *origin, struct kiln_vec3 *direction)
{
    double place[2], lens[2] = {0.0, 0.0};
    walk_draw(&p->walk, 0, &place[0], &place[1]);
    if (p->camera->lens_radius > 0.0f)
        walk_draw(&p->walk, KILN_PATH_LENS, &lens[0], &lens[1]);
    embree_camera_ray(p->camera, pixel, place, lens, origin, direction);
}

/* Follows the path from surface number `surface`, which the ray has hit. */
static void follow_from(struct path *p, struct RTCRayHit *ray, uint32_t surface)
{
    for (;; surface++) {
        struct meeting m = meeting_make(p->walk.b, ray);
        meeting_face(p->walk.b, surface == 0, vec3(ray->ray.dir_x, ray->ray.dir_y, ray->ray.dir_z), &m);
        meeting_lift(p->walk.b, surface == 0 || m.gloss != NULL, &m);
        attenuate(p, &m, ray->ray.tfar);
        if (p->seen[0] > 0.0f || p->seen[1] > 0.0f || p->seen[2] > 0.0f)
            walk_emission(&p->walk, &m, p->seen, sum_of(p));
        if ((is_over(p) && m.gloss == NULL) || !kiln_path_allows(p->camera->length, surface + 2) ||
            !reflect(p, &m, surface == 0))
            return;
        add_lights(p, &m, surface);
        if (!go_on(p, &m, surface, ray))
            return;
    }
}

void path_follow(struct walk *walk, uint32_t key, uint32_t k, uint32_t bounces, const struct RTCRayHit *ray,
                 float radiance[3], float last[3])
{
    const struct kiln_path_parameters parameters = {.bounces = bounces, .length = KILN_PATH_LENGTH_ANY};
    struct path p = {.walk = *walk, .camera = &parameters, .weight = {1.0f, 1.0f, 1.0f}, .bounces = 1, .last = last};
    struct RTCRayHit next = *ray;
    last[0] = last[1] = last[2] = 0.0f;
    p.walk.key = key;
    p.walk.k = k;
    follow_from(&p, &next, 1);
    walk->rays = p.walk.rays;
    for (int c = 0; c < 3; c++)
        radiance[c] = p.radiance[c] + last[c];
}

static void follow(struct path *p, uint64_t pixel)
{
    struct kiln_vec3 origin, direction;
    struct RTCRayHit ray;
    for (int c = 0; c < 3; c++) {
        p->weight[c] = p->seen[c] = 1.0f;
        p->radiance[c] = 0.0f;
    }
    p->bounces = p->chain = 0;
    camera_ray(p, pixel, &origin, &direction);
    if (!look(p, origin, direction, &ray)) {
        walk_environment(&p->walk, direction, p->weight, p->radiance);
        return;
    }
    follow_from(p, &ray, 0);
}

static void trace_pixel(struct path *p, uint64_t pixel, uint32_t seed, const struct kiln_batch *part,
                        struct kiln_path_result *result)
{
    double sum[3] = {0.0, 0.0, 0.0}, square = 0.0;
    p->walk.key = kiln_hash2(kiln_hash2(seed, (uint32_t)pixel), (uint32_t)(pixel >> 32));
    for (uint32_t i = 0; i < part->samples; i++) {
        p->walk.k = part->first_sample + i;
        follow(p, pixel);
        const double luminance = kiln_luminance_of_floats(p->radiance);
        square += luminance * luminance;
        for (int c = 0; c < 3; c++)
            sum[c] += (double)p->radiance[c];
    }
    *result = (struct kiln_path_result){
        .radiance = {(float)sum[0], (float)sum[1], (float)sum[2]}, .square = (float)square, .count = part->samples};
}

int embree_path(struct embree_backend *b, const void *parameters, const struct kiln_batch *part, void *results,
                uint64_t *rays, struct kiln_error *error)
{
    const uint32_t seed = kiln_hash2((uint32_t)b->params.seed, (uint32_t)(b->params.seed >> 32) ^ KILN_PATH_SEED);
    const size_t room = light_choices_room(b->params.lights);
    struct kiln_light_choice *choices = NULL;
    uint64_t traced = 0;
    double seconds = 0.0;
    const int status = kiln_allocate(&choices, room * b->threads, sizeof *choices, "the paths' light choices", error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel num_threads((int)b->threads) reduction(+ : traced, seconds)
    {
        const unsigned saved = embree_enter();
        const double begin = embree_thread_seconds();
        struct embree_context context;
        embree_context(b, &context);
        struct path p = {
            .walk = {.b = b, .context = &context, .choices = choices + room * (size_t)omp_get_thread_num()},
            .camera = parameters};
#pragma omp for schedule(dynamic, 16) nowait
        for (size_t i = 0; i < part->count; i++)
            trace_pixel(&p, (uint64_t)part->first + i, seed, part, (struct kiln_path_result *)results + i);
        traced += p.walk.rays;
        seconds += embree_thread_seconds() - begin;
        embree_leave(saved);
    }
    *rays += traced;
    b->thread_seconds += seconds;
    kiln_free(&choices);
    return KILN_OK;
}
