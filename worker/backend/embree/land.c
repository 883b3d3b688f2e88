/* The land pass (worker/pass/land.h): one path after the other, ray by ray. */
#include <float.h>
#include <math.h>
#include <omp.h>

#include "shaders/shared/chain.h"
#include "shaders/shared/land.h"
#include "shaders/shared/punctual_light.h"
#include "worker/backend/embree/lookup.h"
#include "worker/backend/embree/spheres.h"
#include "worker/backend/embree/techniques.h"
#include "worker/backend/embree/walk.h"
#include "worker/base/color.h"
#include "worker/base/memory.h"
#include "worker/backend/mirror_images.h"
#include "worker/light/aims.h"
#include "worker/pass/land.h"
#include "worker/sampling/sequence.h"
#include "worker/scene/footprint.h"

/* A path under way. */
struct light_path {
    struct walk walk; /* key: of the aim and the iteration; k: index of the path within its aim */
    const struct kiln_land_parameters *parameters;
    uint32_t seed;
    size_t aim;
    uint64_t number; /* among the aim's paths */
    float weight[3]; /* share of the flux that is left, by colour */
    double flux[3];  /* W, at the lamp */
    struct kiln_aimed_ray first;
    struct kiln_caustic_landing sums; /* where there are other techniques */
    bool imaged;                      /* the path continues like light of its lamp's mirror image */
    struct sphere_chords *chords;     /* where there are spheres */
};

static void multiply(struct light_path *p, const float factor[3])
{
    for (int c = 0; c < 3; c++)
        p->weight[c] *= factor[c];
}

static float most(const float weight[3]) { return fmaxf(weight[0], fmaxf(weight[1], weight[2])); }

/* ---- begin ---- */

/* Draws the first ray; false: the lamp sends nothing along it. */
static bool begin(struct light_path *p)
{
    struct kiln_aimed_ray *ray = &p->first;
    double numbers[KILN_AIM_NUMBERS];
    walk_draw(&p->walk, kiln_path_use(0, KILN_PATH_PICK), &numbers[0], &numbers[1]);
    walk_draw(&p->walk, kiln_path_use(0, KILN_PATH_LIGHT), &numbers[2], &numbers[3]);
    walk_draw(&p->walk, kiln_path_use(0, KILN_PATH_BOUNCE), &numbers[4], &numbers[5]);
    const struct kiln_aims *aims = p->parameters->aims;
    const double paths = (double)(aims->first[p->aim + 1] - aims->first[p->aim]);
    if (!kiln_aims_draw(aims, p->aim, p->number, numbers, ray))
        return false;
    for (int c = 0; c < 3; c++) {
        p->flux[c] = ray->flux[c] / paths;
        p->weight[c] = 1.0f;
    }
    return p->flux[0] > 0.0 || p->flux[1] > 0.0 || p->flux[2] > 0.0;
}

/* Whether the first hit is the path's target; adapts its flux to that surface. */
static bool meets_target(struct light_path *p, const struct meeting *m)
{
    const double factor = m->gloss != NULL ? kiln_aims_met(p->parameters->aims, p->aim, &p->first, m->triangle) : 0.0;
    for (int c = 0; c < 3; c++)
        p->flux[c] *= factor;
    return factor > 0.0;
}

/* ---- landing ---- */

static void land(const struct light_path *p, const struct meeting *m, struct kiln_vec3 direction,
                 struct kiln_land_result *result)
{
    const struct kiln_vec3 back = vec3_scale(direction, -1.0f);
    const float above = vec3_dot(m->normal, back), cosine = vec3_dot(m->shading, back);
    result->end = KILN_LAND_LANDED;
    result->point = p->imaged ? KILN_NO_POINT : embree_point(p->walk.b, m->triangle, m->u, m->v, m->back).at;
    result->shading = above > 0.0f ? fmaxf(0.0f, cosine) / above : 1.0f;
    const struct kiln_caustic_techniques *t = p->parameters->techniques;
    if (t != NULL)
        result->others = (float)fmin(kiln_caustic_others(t->mis, &p->sums), (double)FLT_MAX);
    result->taken_up = m->gloss != NULL ? kiln_chain_taken_up(m->lobes, m->o.z) : 1.0f;
}

/* Whether the path lands on surface number `surface`, which is not the first one, instead of continuing. */
static bool lands(struct light_path *p, const struct meeting *m, uint32_t surface)
{
    double pick, rest;
    if (m->gloss == NULL || p->parameters->spheres != NULL)
        return m->gloss == NULL;
    if (m->back && (p->walk.b->params.geometry->records[m->triangle].material & KILN_RECORD_DOUBLE_SIDED) == 0)
        return false; /* there is no point on this side */
    walk_draw(&p->walk, kiln_path_use(surface, KILN_PATH_END), &pick, &rest);
    const float diffuse = kiln_bsdf_choice_of(m->shares, KILN_LOBE_ALL).diffuse, least = kiln_land_least(surface),
                chance = diffuse > least ? diffuse : least;
    const bool here = pick < (double)chance;
    const float one = 1.0f / (here ? chance : 1.0f - chance);
    multiply(p, (const float[3]){one, one, one});
    return here;
}

/* ---- the way on ---- */

/* Draws a direction at a surface with gloss; false: it contributes nothing. */
static bool turn(struct light_path *p, const struct meeting *m, uint32_t surface, float pick,
                 struct kiln_vec3 *direction)
{
    double u, v;
    const uint32_t lobes = surface == 1 && p->parameters->spheres != NULL ? m->sharp : m->others;
    walk_draw(&p->walk, kiln_path_use(surface, KILN_PATH_BOUNCE), &u, &v);
    if (lobes == 0)
        return false;
    const struct kiln_bsdf_choice choice = kiln_bsdf_choice_of(m->shares, lobes);
    struct kiln_bsdf_drawn d = kiln_bsdf_propose(m->lobes, choice, m->o, pick, (float)u, (float)v, KILN_IMPORTANCE);
    if (d.i.z == 0.0f)
        return false;
    if (!d.delta) {
        const struct kiln_bsdf_value f = kiln_bsdf_evaluate_chosen(m->lobes, choice, m->o, d.i, KILN_IMPORTANCE, lobes);
        if (!(f.density > 0.0f))
            return false;
        d.weight = vec3_scale(f.value, 1.0f / f.density);
    }
    const float facing = m->o.z > 0.0f ? 1.0f : -1.0f; /* the meeting's normals are on the side that was hit */
    const struct kiln_vec3 front = kiln_into_frame(&m->frame, vec3_scale(m->normal, facing));
    const float correction = kiln_shading_correction(m->o, d.i, front);
    multiply(p, (const float[3]){d.weight.x * correction, d.weight.y * correction, d.weight.z * correction});
    *direction = kiln_out_of_frame(&m->frame, d.i);
    return kiln_shading_agrees(d.i, front) && most(p->weight) > 0.0f;
}

/* Sums of the path at its first surface, as it arrives from its lamp. */
static struct kiln_caustic_landing emit(const struct light_path *p, const struct vertex *v)
{
    const struct kiln_caustic_techniques *t = p->parameters->techniques;
    const struct kiln_aimed_ray *ray = &p->first;
    const struct kiln_dvec3 direction = dvec3_of(ray->direction), way = dvec3_sub(dvec3_of(v->m.position), ray->place);
    return kiln_caustic_emit(techniques_connect(t, ray->light, v, ray->place, direction),
                             techniques_emission(t, ray->light, v, ray->place, direction), ray->cosine, ray->is_point,
                             ray->has_place ? dvec3_dot(way, way) : 1.0, fabs((double)vec3_dot(v->m.normal, v->from)));
}

/* Whether the reflection at surface number `surface` is one that mirror images of lamps in flat mirrors represent. */
static bool is_image(const struct light_path *p, const struct meeting *m, uint32_t surface,
                     const struct vertex_way *way)
{
    const struct kiln_mirror_images *images = p->parameters->techniques->images;
    return images != NULL && surface == 1 && p->first.is_point && !m->back && way->delta &&
           images->plane_of[m->triangle] != KILN_NONE && vec3_dot(m->normal, way->direction) > 0.0f;
}

/* Sums of the path as it arrives at surface number `surface`. */
static struct kiln_caustic_landing arrive(const struct light_path *p, const struct vertex *v, uint32_t surface)
{
    struct kiln_caustic_landing sums = p->sums;
    if (surface == 1)
        return emit(p, v);
    kiln_caustic_meet(&sums, fabs((double)vec3_dot(v->m.normal, v->from)));
    return sums;
}

/* As `turn`, if other techniques share the light. `from`: the path's present direction. */
static bool turn_weighed(struct light_path *p, const struct meeting *m, uint32_t surface, float pick,
                         struct kiln_vec3 from, struct kiln_vec3 *direction)
{
    const struct vertex v = vertex_of(p->walk.b, m, from);
    struct vertex_way way;
    double numbers[4] = {(double)pick, 0.5};
    walk_draw(&p->walk, kiln_path_use(surface, KILN_PATH_BOUNCE), &numbers[2], &numbers[3]);
    if (!vertex_leave(p->walk.b, &v, true, m->others, numbers, &way))
        return false;
    p->sums = arrive(p, &v, surface);
    kiln_caustic_pass_on(&p->sums, surface == 1, way.cosine, way.forward, way.backward, way.delta);
    p->imaged = is_image(p, m, surface, &way);
    multiply(p, way.factor);
    *direction = way.direction;
    return most(p->weight) > 0.0f;
}

/* Continues from surface number `surface`, by Russian roulette; false: the path ends. */
static bool go_on(struct light_path *p, const struct meeting *m, uint32_t surface, struct kiln_vec3 *origin,
                  struct kiln_vec3 *direction)
{
    const uint32_t asked = p->walk.b->params.chain_length, length = asked != 0 ? asked : KILN_CHAIN_LENGTH;
    double pick, rest;
    walk_draw(&p->walk, kiln_path_use(surface, KILN_PATH_LOBE), &pick, &rest);
    const float left = kiln_chain_left(m->albedo, vec3(p->weight[0], p->weight[1], p->weight[2])),
                chance = kiln_chain_chance(surface - 1, length, left), one = 1.0f / chance;
    const struct kiln_vec3 from = *direction;
    if (rest >= (double)chance ||
        !(p->parameters->techniques != NULL ? turn_weighed(p, m, surface, (float)pick, from, direction)
                                            : turn(p, m, surface, (float)pick, direction)))
        return false;
    const float side = vec3_dot(m->normal, *direction) > 0.0f ? m->offset : -m->offset;
    multiply(p, (const float[3]){one, one, one});
    *origin = vec3_madd(m->position, m->normal, side);
    return true;
}

/* ---- probes ---- */

/* Adds light to the spheres on the way from surface number `surface` - 1 to `end`; NULL: to infinity. */
static void cross(struct light_path *p, uint32_t surface, struct kiln_vec3 origin, struct kiln_vec3 direction,
                  double length, const struct meeting *end)
{
    const struct kiln_aims *aims = p->parameters->aims;
    struct spheres_part part = {.origin = origin, .direction = direction, .length = length, .aim = p->aim, .end = end};
    double rest;
    if (p->parameters->spheres == NULL || surface == 1)
        return;
    for (int c = 0; c < 3; c++)
        part.flux[c] = p->flux[c] * (double)p->weight[c];
    part.relative =
        kiln_luminance(part.flux) * (double)(aims->first[p->aim + 1] - aims->first[p->aim]) / aims->aims[p->aim].flux;
    part.chance = kiln_hash2(kiln_path_key(p->walk.key, kiln_path_use(surface, KILN_PATH_CHANCE)), p->walk.k);
    walk_draw(&p->walk, kiln_path_use(surface, KILN_PATH_SKY), &part.pick, &rest);
    spheres_cross(&p->walk, p->parameters->spheres, &part, p->chords);
}

/* ---- paths ---- */

/* Follows the path to its end. */
static enum kiln_land_end follow(struct light_path *p, struct kiln_land_result *result)
{
    struct RTCRayHit ray;
    const struct kiln_probe_spheres *spheres = p->parameters->spheres;
    if (!begin(p) || (spheres != NULL && !kiln_aims_is_left(p->parameters->aims, p->aim, spheres->leaves)))
        return KILN_LAND_ASTRAY;
    struct kiln_vec3 origin = p->first.origin, direction = p->first.direction;
    for (uint32_t surface = 1;; surface++) {
        float share[3] = {1.0f, 1.0f, 1.0f};
        p->walk.rays++;
        if (!walk_trace(&p->walk, origin, direction, kiln_path_use(surface, KILN_PATH_CHANCE), share, &ray)) {
            cross(p, surface, origin, direction, (double)INFINITY, NULL);
            return surface == 1 ? KILN_LAND_ASTRAY : KILN_LAND_ESCAPED;
        }
        struct meeting m = meeting_make(p->walk.b, &ray);
        cross(p, surface, origin, direction, (double)ray.ray.tfar, &m);
        multiply(p, share);
        result->length = surface < UINT16_MAX ? (uint16_t)surface : UINT16_MAX;
        if (surface == 1 && !meets_target(p, &m))
            return KILN_LAND_ASTRAY;
        if (!meeting_has_side(p->walk.b, meeting_record(p->walk.b, &ray), m.back))
            return KILN_LAND_BLOCKED;
        meeting_face(p->walk.b, true, direction, &m);
        if (meeting_attenuation(&m, ray.ray.tfar, share))
            multiply(p, share);
        for (int c = 0; c < 3 && surface == 1; c++)
            p->flux[c] *= kiln_light_range(p->first.range, (double)ray.ray.tfar);
        if (surface > 1 && lands(p, &m, surface)) {
            land(p, &m, direction, result);
            return KILN_LAND_LANDED;
        }
        if (!go_on(p, &m, surface, &origin, &direction))
            return KILN_LAND_ABSORBED;
    }
}

static void trace_path(struct light_path *p, uint64_t number, struct kiln_land_result *result)
{
    const struct kiln_aims *aims = p->parameters->aims;
    const uint64_t iteration = number / aims->paths, path = number % aims->paths;
    p->aim = kiln_aims_find(aims, path);
    p->imaged = false;
    const uint64_t k = path - aims->first[p->aim];
    *result = (struct kiln_land_result){.point = KILN_NO_POINT, .aim = (uint32_t)p->aim};
    p->walk.key =
        kiln_land_key(p->seed, (uint32_t)p->aim, (uint32_t)iteration, (uint32_t)(iteration >> 32), (uint32_t)(k >> 32));
    p->walk.k = (uint32_t)k;
    p->number = k;
    result->end = (uint16_t)follow(p, result);
    for (int c = 0; c < 3 && result->end != KILN_LAND_ASTRAY && result->end != KILN_LAND_ABSORBED; c++)
        result->flux[c] = (float)(p->flux[c] * (double)p->weight[c]);
}

static uint32_t seed_of(const struct embree_backend *b)
{
    return kiln_hash2((uint32_t)b->params.seed, (uint32_t)(b->params.seed >> 32) ^ KILN_LAND_SEED);
}

/* Adds the chords recorded by threads to the sums of spheres. Called by all threads. */
static void add_chords(const struct kiln_probe_spheres *spheres, struct sphere_chords *threads, size_t count)
{
    bool all = true;
    sphere_chords_end(&threads[omp_get_thread_num()], spheres);
#pragma omp barrier
    for (size_t t = 0; t < count; t++)
        all = all && threads[t].status == KILN_OK;
#pragma omp for schedule(dynamic, 8) nowait
    for (size_t stretch = 0; stretch < sphere_stretches(spheres); stretch++)
        if (all)
            sphere_stretch_add(spheres, threads, count, stretch);
}

/* Allocates a list of chords for each of the backend's threads. A chord is the part of a light path inside a sphere
 * about a probe (worker/pass/spheres.h). */
static int begin_chords(const struct embree_backend *b, const struct kiln_probe_spheres *spheres,
                        struct sphere_chords **threads, struct kiln_error *error)
{
    int status = kiln_allocate(threads, b->threads, sizeof **threads, "the chords of light paths", error);
    for (size_t t = 0; t < b->threads && status == KILN_OK; t++)
        status = sphere_chords_begin(&(*threads)[t], spheres, error);
    return status;
}

static int end_chords(const struct embree_backend *b, struct sphere_chords **threads, int status,
                      struct kiln_error *error)
{
    for (size_t t = 0; *threads != NULL && t < b->threads; t++) {
        if (status == KILN_OK && (*threads)[t].status != KILN_OK) {
            status = (*threads)[t].status;
            *error = (*threads)[t].error;
        }
        sphere_chords_release(&(*threads)[t]);
    }
    kiln_free(threads);
    return status;
}

int embree_land(struct embree_backend *b, const void *parameters, const struct kiln_batch *part, void *results,
                uint64_t *rays, struct kiln_error *error)
{
    const struct kiln_probe_spheres *spheres = ((const struct kiln_land_parameters *)parameters)->spheres;
    struct sphere_chords *chords = NULL;
    uint64_t traced = 0;
    double seconds = 0.0;
    const int status = spheres != NULL ? begin_chords(b, spheres, &chords, error) : KILN_OK;
    if (status != KILN_OK)
        return end_chords(b, &chords, status, error);
#pragma omp parallel num_threads((int)b->threads) reduction(+ : traced, seconds)
    {
        const unsigned saved = embree_enter();
        const double begin_seconds = embree_thread_seconds();
        struct embree_context context;
        embree_context(b, &context);
        struct light_path p = {.walk = {.b = b, .context = &context},
                               .parameters = parameters,
                               .seed = seed_of(b),
                               .chords = chords != NULL ? &chords[omp_get_thread_num()] : NULL};
#pragma omp for schedule(dynamic, 256) nowait
        for (size_t i = 0; i < part->count; i++)
            trace_path(&p, (uint64_t)part->first + i, (struct kiln_land_result *)results + i);
        if (spheres != NULL)
            add_chords(spheres, chords, (size_t)omp_get_num_threads());
        traced += p.walk.rays;
        seconds += embree_thread_seconds() - begin_seconds;
        embree_leave(saved);
    }
    *rays += traced;
    b->thread_seconds += seconds;
    return end_chords(b, &chords, KILN_OK, error);
}
