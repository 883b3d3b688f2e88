/* The path pass (worker/pass/path.h): one path after the other, ray by ray. shaders/path.glsl goes the same ways. */
#include <math.h>
#include <omp.h>
#include <string.h>

#include "shaders/shared/color.h"
#include "shaders/shared/warp.h"
#include "worker/backend/embree/light_samples.h"
#include "worker/backend/embree/meeting.h"
#include "worker/backend/embree/shadow.h"
#include "worker/base/memory.h"
#include "worker/pass/path.h"
#include "worker/scene/footprint.h"
#include "worker/scene/texture.h"

/* A path under way. */
struct path {
    const struct embree_backend *b;
    struct embree_context *context;
    const struct kiln_path_parameters *camera;
    struct kiln_light_choice *choices;
    uint32_t key, k; /* of the pixel; number of the sample */
    float weight[3]; /* what of the radiance that comes now reaches the camera, by colour */
    float seen[3];   /* the same, of what the next surface emits itself: 0 where light samples have brought that */
    float radiance[3];
    uint32_t bounces, chain; /* diffuse surfaces that have sent the path on; others since the last one */
    uint64_t rays;
};

/* Two numbers in (0, 1) of this sample. */
static void draw(const struct path *p, uint32_t use, double *u, double *v)
{
    uint32_t a, b;
    kiln_path_numbers(kiln_path_key(p->key, use), p->k, &a, &b);
    *u = kiln_unit_double(a);
    *v = kiln_unit_double(b);
}

static void add(struct path *p, const float weight[3], const float rgb[3])
{
    for (int c = 0; c < 3; c++)
        p->radiance[c] += weight[c] * rgb[c];
}

static void multiply(struct path *p, const float factor[3])
{
    for (int c = 0; c < 3; c++) {
        p->weight[c] *= factor[c];
        p->seen[c] *= factor[c];
    }
}

static void add_environment(struct path *p, const float weight[3], struct kiln_vec3 direction)
{
    float rgb[3];
    kiln_environment_radiance(p->b->params.lights, dvec3_of(direction), rgb);
    add(p, weight, rgb);
}

/* ---- rays ---- */

/* Traces the ray that leads to surface number `surface`; false: it meets nothing. */
static bool trace(struct path *p, struct kiln_vec3 origin, struct kiln_vec3 direction, uint32_t surface,
                  struct RTCRayHit *ray)
{
    float tint[3] = {1.0f, 1.0f, 1.0f};
    *ray = (struct RTCRayHit){.ray = {.org_x = origin.x,
                                      .org_y = origin.y,
                                      .org_z = origin.z,
                                      .dir_x = direction.x,
                                      .dir_y = direction.y,
                                      .dir_z = direction.z,
                                      .tfar = INFINITY,
                                      .mask = ~0u},
                              .hit = {.geomID = RTC_INVALID_GEOMETRY_ID, .instID = {RTC_INVALID_GEOMETRY_ID}}};
    const uint32_t chance = kiln_path_key(p->key, kiln_path_use(surface, KILN_PATH_CHANCE));
    embree_nearest1(p->b, p->context, ray, kiln_hash2(chance, p->k), tint);
    multiply(p, tint);
    return ray->hit.geomID != RTC_INVALID_GEOMETRY_ID;
}

static bool is_seen(const struct embree_backend *b, const struct RTCRayHit *r)
{
    const struct kiln_hit_record *record =
        &b->params.geometry->records[embree_triangle(b, r->hit.geomID, r->hit.primID)];
    const bool hidden = (b->params.scene->objects[record->object].flags & KILN_OBJECT_CASTER_ONLY) != 0 &&
                        (record->material & KILN_RECORD_EMITS) == 0;
    return !hidden && meeting_has_side(b, record, meeting_is_back(r));
}

/* What the camera sees along the ray; false: nothing but the environment. */
static bool look(struct path *p, struct kiln_vec3 origin, struct kiln_vec3 direction, struct RTCRayHit *ray)
{
    p->rays++;
    for (uint32_t i = 0; i <= KILN_PATH_UNSEEN; i++) {
        if (!trace(p, origin, direction, 0, ray))
            return false;
        if (is_seen(p->b, ray))
            return true;
        origin = vec3_madd(origin, direction, kiln_path_beyond(ray->ray.tfar, p->b->params.geometry->extent));
    }
    return false;
}

/* ---- surfaces ---- */

static void add_emission(struct path *p, const struct meeting *m)
{
    float rgb[3];
    if ((p->b->params.geometry->records[m->triangle].material & KILN_RECORD_EMITS) == 0)
        return;
    kiln_surface_emission(p->b->params.scene, m->mesh, m->stored, m->b1, m->b2, rgb);
    add(p, p->seen, rgb);
}

/* What the body that the ray has come through has left of the light: the ray meets its surface from within. */
static void attenuate(struct path *p, const struct meeting *m, float distance)
{
    float share[3];
    if (meeting_attenuation(m, distance, share))
        multiply(p, share);
}

/* Goes on to what the surface reflects; false: it is black. */
static bool reflect(struct path *p, const struct meeting *m, bool first)
{
    float color[4];
    if (m->gloss != NULL)
        return true;
    (first ? kiln_surface_base_color : kiln_surface_color)(p->b->params.scene, m->mesh, m->stored, m->b1, m->b2, color);
    for (int c = 0; c < 3; c++)
        p->weight[c] *= color[c];
    return p->weight[0] > 0.0f || p->weight[1] > 0.0f || p->weight[2] > 0.0f;
}

/* ---- straight from the lights ---- */

static struct kiln_light_sample draw_light(const struct path *p, const struct meeting *m, uint32_t surface,
                                           const struct kiln_light_choice *choice, uint32_t index, bool *good)
{
    const bool sky = choice->kind == KILN_CHOICE_ENVIRONMENT;
    struct kiln_light_sample sample = {0};
    double u = 0.5, v = 0.5, pick = 0.5, rest;
    if (choice->kind != KILN_CHOICE_DIRECTIONAL) {
        draw(p, kiln_path_use(surface, sky ? KILN_PATH_SKY + index : KILN_PATH_LIGHT), &u, &v);
        draw(p, kiln_path_use(surface, KILN_PATH_PICK), &pick, &rest);
    }
    *good = kiln_lights_sample(p->b->params.lights, choice, index, dvec3_of(m->position), dvec3_of(m->normal),
                               dvec3_of(m->shading), pick, u, v, &sample);
    return sample;
}

/* What a surface that is not only diffuse sends to the path of light from a direction, times the cosine: of light that
 * rays meet themselves, what its sharp lobes do is left to these. */
static void scatter(const struct meeting *m, const struct kiln_light_sample *sample, float scattered[3])
{
    const uint32_t lobes = sample->has_extent ? KILN_LOBE_ALL & ~m->sharp : KILN_LOBE_ALL;
    const struct kiln_bsdf_value f = meeting_evaluate(m, kiln_into_frame(&m->frame, vec3_of(sample->direction)), lobes);
    scattered[0] = f.value.x;
    scattered[1] = f.value.y;
    scattered[2] = f.value.z;
}

/* Adds what one sample of a choice brings. */
static void add_sample(struct path *p, const struct meeting *m, const struct kiln_light_choice *choice,
                       struct kiln_light_sample *sample)
{
    const double above = dvec3_dot(dvec3_of(m->normal), sample->direction),
                 cosine = dvec3_dot(dvec3_of(m->shading), sample->direction);
    const struct kiln_vec3 start = vec3_madd(m->position, m->normal, m->offset);
    if (!(above > 0.0) || !(cosine > 0.0))
        return;
    p->rays++;
    shadow_aim(sample, dvec3_of(m->position), dvec3_of(start));
    if (!light_arrives(p->b, p->context, start, choice, sample))
        return;
    float rgb[3], scattered[3] = {0.0f, 0.0f, 0.0f};
    if (m->gloss != NULL)
        scatter(m, sample, scattered);
    for (int c = 0; c < 3; c++)
        rgb[c] = (float)(sample->value[c] * (m->gloss != NULL ? (double)scattered[c] : cosine * (1.0 / KILN_PI)));
    add(p, p->weight, rgb);
}

static void add_direct(struct path *p, const struct meeting *m, uint32_t surface)
{
    const struct kiln_lights *lights = p->b->params.lights;
    size_t count = kiln_lights_choices(lights, dvec3_of(m->position), 0.0, dvec3_of(m->normal), 1, p->choices);
    if (light_sky_is_constant(lights))
        count--; /* the environment is the last choice */
    for (size_t i = 0; i < count; i++) {
        struct kiln_light_choice *choice = &p->choices[i];
        choice->samples = choice->kind == KILN_CHOICE_ENVIRONMENT ? 2 : 1; /* by the cosine, and by luminance */
        for (uint32_t index = 0; index < choice->samples; index++) {
            bool good;
            struct kiln_light_sample sample = draw_light(p, m, surface, choice, index, &good);
            if (good)
                add_sample(p, m, choice, &sample);
        }
    }
}

/* ---- the way on ---- */

/* Cosine-distributed about the axis, with which it has the cosine `cosine`. */
static struct kiln_vec3 cosine_direction(struct kiln_vec3 axis, double u, double v, float *cosine)
{
    struct kiln_vec3 s, t;
    const float radius = (float)sqrt(u), turn = (float)(2.0 * KILN_PI * v);
    kiln_basis(axis, &s, &t);
    *cosine = (float)sqrt(1.0 - u);
    return vec3_madd(vec3_madd(vec3_scale(axis, *cosine), s, radius * cosf(turn)), t, radius * sinf(turn));
}

/* The way on from a surface that is not only diffuse. Chance chooses whether the diffuse surface sends the path on or
 * the other lobes do, so that bounces can be counted. */
static bool turn_by_lobes(struct path *p, const struct meeting *m, uint32_t surface, struct kiln_vec3 *direction,
                          bool *diffuse)
{
    double u, v, pick, rest;
    float sharp[3], weight[3];
    draw(p, kiln_path_use(surface, KILN_PATH_BOUNCE), &u, &v);
    draw(p, kiln_path_use(surface, KILN_PATH_LOBE), &pick, &rest);
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

/* Chooses the way on from the surface, and weighs it as the gather pass does; false: it brings nothing. */
static bool turn(struct path *p, const struct meeting *m, uint32_t surface, struct kiln_vec3 *direction, bool *diffuse)
{
    double u, v;
    float cosine;
    *diffuse = true;
    if (m->gloss != NULL)
        return turn_by_lobes(p, m, surface, direction, diffuse);
    draw(p, kiln_path_use(surface, KILN_PATH_BOUNCE), &u, &v);
    const struct kiln_vec3 both = vec3_add(m->normal, m->shading); /* twice the normal but for smooth meshes */
    *direction = cosine_direction(vec3_normalize(both), u, v, &cosine);
    const float weight = kiln_shading_weight(vec3_dot(m->shading, *direction), cosine);
    for (int c = 0; c < 3; c++) {
        p->weight[c] *= weight;
        p->seen[c] = 0.0f;
    }
    return weight > 0.0f && vec3_dot(m->normal, *direction) > 0.0f;
}

/* Whether a path that has no last surface, or goes from mirror to mirror, goes on from surface number `surface`. */
static bool survives(struct path *p, uint32_t surface)
{
    double u, v;
    const bool endless = p->camera->bounces == KILN_PATH_ALL_BOUNCES || p->chain >= KILN_PATH_CHAIN;
    if (!endless || surface < KILN_PATH_CERTAIN)
        return true;
    const float chance = kiln_path_chance(p->weight[0], p->weight[1], p->weight[2]);
    draw(p, kiln_path_use(surface, KILN_PATH_END), &u, &v);
    for (int c = 0; c < 3; c++)
        p->weight[c] /= chance;
    return u < (double)chance;
}

/* From surface number `surface` to the next; false: the path ends. */
static bool go_on(struct path *p, const struct meeting *m, uint32_t surface, struct RTCRayHit *ray)
{
    const bool sky = light_sky_is_constant(p->b->params.lights), may_end = m->gloss == NULL && !sky;
    struct kiln_vec3 direction;
    bool diffuse;
    if ((may_end && p->bounces == p->camera->bounces) || !survives(p, surface) ||
        !turn(p, m, surface, &direction, &diffuse))
        return false;
    const bool last = diffuse && p->bounces == p->camera->bounces;
    const float side = vec3_dot(m->normal, direction) > 0.0f ? m->offset : -m->offset;
    if (last && !sky)
        return false;
    p->bounces += diffuse;
    p->chain = diffuse ? 0 : p->chain + 1;
    p->rays++;
    if (trace(p, vec3_madd(m->position, m->normal, side), direction, surface + 1, ray))
        return !last &&
               meeting_has_side(
                   p->b, &p->b->params.geometry->records[embree_triangle(p->b, ray->hit.geomID, ray->hit.primID)],
                   meeting_is_back(ray));
    add_environment(p, sky ? p->weight : p->seen, direction);
    return false;
}

/* ---- paths ---- */

static void camera_ray(const struct path *p, uint64_t pixel, struct kiln_vec3 *origin, struct kiln_vec3 *direction)
{
    const struct kiln_path_parameters *c = p->camera;
    double u, v;
    draw(p, 0, &u, &v);
    const float x = (float)(((double)(pixel % c->width) + u) / c->width * 2.0 - 1.0),
                y = (float)(1.0 - ((double)(pixel / c->width) + v) / c->height * 2.0);
    const struct kiln_vec3 aside = vec3_madd(vec3_scale(c->right, x), c->up, y);
    *origin = c->orthographic ? vec3_add(c->position, aside) : c->position;
    *direction = vec3_normalize(c->orthographic ? c->forward : vec3_add(c->forward, aside));
    if (!(c->lens_radius > 0.0f))
        return;
    draw(p, KILN_PATH_LENS, &u, &v);
    const struct kiln_vec3 place = kiln_path_lens(c->right, c->up, c->lens_radius, (float)u, (float)v),
                           focus = vec3_scale(vec3_add(c->forward, aside), c->focus_distance);
    *origin = vec3_add(*origin, place);
    *direction = vec3_normalize(vec3_sub(focus, place));
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
        add_environment(p, p->weight, direction);
        return;
    }
    for (uint32_t surface = 0;; surface++) {
        struct meeting m = meeting_make(p->b, &ray);
        meeting_face(p->b, surface == 0, vec3(ray.ray.dir_x, ray.ray.dir_y, ray.ray.dir_z), &m);
        attenuate(p, &m, ray.ray.tfar);
        if (p->seen[0] > 0.0f || p->seen[1] > 0.0f || p->seen[2] > 0.0f)
            add_emission(p, &m);
        if (!reflect(p, &m, surface == 0))
            return;
        add_direct(p, &m, surface);
        if (!go_on(p, &m, surface, &ray))
            return;
    }
}

static void trace_pixel(struct path *p, uint64_t pixel, uint32_t seed, const struct kiln_batch *part,
                        struct kiln_path_result *result)
{
    double sum[3] = {0.0, 0.0, 0.0}, square = 0.0;
    p->key = kiln_hash2(kiln_hash2(seed, (uint32_t)pixel), (uint32_t)(pixel >> 32));
    for (uint32_t i = 0; i < part->samples; i++) {
        p->k = part->first_sample + i;
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
        struct path p = {.b = b,
                         .context = &context,
                         .camera = parameters,
                         .choices = choices + room * (size_t)omp_get_thread_num()};
#pragma omp for schedule(dynamic, 16) nowait
        for (size_t i = 0; i < part->count; i++)
            trace_pixel(&p, (uint64_t)part->first + i, seed, part, (struct kiln_path_result *)results + i);
        traced += p.rays;
        seconds += embree_thread_seconds() - begin;
        embree_leave(saved);
    }
    *rays += traced;
    b->thread_seconds += seconds;
    kiln_free(&choices);
    return KILN_OK;
}
