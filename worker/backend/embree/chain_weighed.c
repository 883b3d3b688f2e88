#include "worker/backend/embree/chain_weighed.h"

#include <math.h>
#include <string.h>

#include "worker/backend/embree/shadow.h"
#include "worker/backend/embree/techniques.h"

/* A chain under way. */
struct chain {
    struct walk *walk;
    const struct kiln_caustic_techniques *t;
    float weight[3]; /* weight of incoming radiance at the chain's beginning */
    struct kiln_caustic_gathered sums;
    float *light; /* what is found */
};

static void multiply(struct chain *c, const float factor[3])
{
    for (int i = 0; i < 3; i++)
        c->weight[i] *= factor[i];
}

/* Multiplies the chain's weight by that of a path. */
static void weigh(const struct chain *c, double by, float weight[3])
{
    for (int i = 0; i < 3; i++)
        weight[i] = (float)((double)c->weight[i] * by);
}

/* ---- lights that the chain hits ---- */

/* Weight of a light that the chain has hit. `before`: the surface where its ray started. */
static double weigh_hit(const struct chain *c, const struct vertex *before, uint32_t light, struct kiln_dvec3 place,
                        struct kiln_dvec3 direction)
{
    return kiln_caustic_weight_hit(c->t->mis, &c->sums, techniques_connect(c->t, light, before, place, direction),
                                   techniques_emission(c->t, light, before, place, direction));
}

static void meet_emitter(struct chain *c, const struct vertex *before, const struct meeting *m,
                         struct kiln_vec3 direction)
{
    const struct kiln_emission *emission = c->t->emission;
    const uint32_t light = kiln_emission_at(emission, m->triangle, (double)m->u, (double)m->v);
    double by = 1.0;
    float weight[3];
    if (light != KILN_NONE && !(m->back && !emission->lights->areas[light].two_sided)) {
        const struct kiln_vec3 place = kiln_triangle_position(c->walk->b->params.geometry, m->triangle, m->u, m->v);
        by = weigh_hit(c, before, light, dvec3_of(place), dvec3_of(vec3_scale(direction, -1.0f)));
    }
    weigh(c, by, weight);
    walk_emission(c->walk, m, weight, c->light);
}

static void meet_environment(struct chain *c, const struct vertex *before, struct kiln_vec3 direction)
{
    const struct kiln_emission *emission = c->t->emission;
    const struct kiln_dvec3 from = dvec3_of(vec3_scale(direction, -1.0f));
    float weight[3];
    if (!emission->lights->environment)
        return;
    weigh(c, weigh_hit(c, before, kiln_emission_environment(emission), from, from), weight);
    walk_environment(c->walk, direction, weight, c->light);
}

/* ---- samples of lights ---- */

/* Adds the light of a sample at vertex `v`. `light`: index of its light. */
static void add_sample(struct chain *c, const struct vertex *v, const struct kiln_light_choice *choice, uint32_t light,
                       struct kiln_light_sample *sample)
{
    const struct embree_backend *b = c->walk->b;
    const struct kiln_lights *lights = c->t->emission->lights;
    const bool outside = !isfinite(sample->distance);
    const struct kiln_dvec3 place = dvec3_of(v->m.position), down = dvec3_scale(sample->direction, -1.0),
                            end = outside ? place : dvec3_add(place, dvec3_scale(sample->direction, sample->distance));
    const struct kiln_vec3 direction = vec3_of(sample->direction), start = vertex_start(v, direction);
    const double squared = outside ? 1.0 : sample->distance * sample->distance,
                 cosine =
                     light < lights->area_count ? fabs(dvec3_dot(lights->areas[light].normal, sample->direction)) : 1.0;
    struct vertex_scatter s;
    float weight[3];
    if (!vertex_scatter(b, v, v->from, direction, v->m.others, &s))
        return;
    const double connect = techniques_connect(c->t, light, v, end, down),
                 emission = techniques_emission(c->t, light, v, end, down);
    c->walk->rays++;
    shadow_aim(sample, place, dvec3_of(start));
    if (!(connect > 0.0) || !light_arrives(b, c->walk->context, start, choice, sample))
        return;
    const double hit = sample->has_extent ? s.to_light * cosine / squared : 0.0;
    const double towards = s.cosine_i / squared;
    weigh(c, kiln_caustic_weight_sampled(c->t->mis, &c->sums, connect, emission, towards, hit, s.to_eye), weight);
    if (!outside)
        vertex_attenuate(v, direction, (float)sample->distance, weight);
    for (int i = 0; i < 3; i++)
        c->light[i] += weight[i] * (float)(sample->value[i] * s.all[i] * s.cosine_i);
}

static void sample_choice(struct chain *c, const struct vertex *v, uint32_t surface, struct kiln_light_choice choice,
                          uint32_t light)
{
    const bool tree = choice.kind == KILN_CHOICE_LIGHT_NODE;
    const struct kiln_dvec3 n = subpaths_light_normal(v);
    struct kiln_light_sample sample = {0};
    double u = 0.5, w = 0.5, pick = 0.5, rest;
    if (tree) {
        walk_draw(c->walk, kiln_path_use(surface, KILN_PATH_LIGHT), &u, &w);
        walk_draw(c->walk, kiln_path_use(surface, KILN_PATH_PICK), &pick, &rest);
    }
    if (kiln_lights_sample(c->t->emission->lights, &choice, 0, dvec3_of(v->m.position), n, n, pick, u, w, &sample))
        add_sample(c, v, &choice, tree ? sample.light : light, &sample);
}

/* Samples the environment by luminance alone: rays of the chain find the rest. */
static void sample_environment(struct chain *c, const struct vertex *v, uint32_t surface)
{
    const struct kiln_lights *lights = c->t->emission->lights;
    const struct kiln_light_choice choice = {.kind = KILN_CHOICE_ENVIRONMENT, .samples = 1};
    struct kiln_light_sample sample = {.distance = (double)INFINITY, .has_extent = true};
    double u, w, density;
    float rgb[3];
    walk_draw(c->walk, kiln_path_use(surface, KILN_PATH_SKY), &u, &w);
    sample.direction = kiln_environment_sample(lights, u, w, &density);
    if (!(density > 0.0))
        return;
    kiln_environment_radiance(lights, sample.direction, rgb);
    for (int i = 0; i < 3; i++)
        sample.value[i] = (double)rgb[i] / density;
    add_sample(c, v, &choice, kiln_emission_environment(c->t->emission), &sample);
}

static void sample_lights(struct chain *c, const struct vertex *v, uint32_t surface)
{
    const struct kiln_emission *emission = c->t->emission;
    const struct kiln_lights *lights = emission->lights;
    if (vertex_is_smooth(v))
        return;
    if (lights->node_count > 0)
        sample_choice(c, v, surface, (struct kiln_light_choice){.kind = KILN_CHOICE_LIGHT_NODE, .samples = 1},
                      KILN_NONE);
    for (size_t i = 0; i < lights->directional_count; i++)
        sample_choice(c, v, surface,
                      (struct kiln_light_choice){.kind = KILN_CHOICE_DIRECTIONAL, .index = (uint32_t)i, .samples = 1},
                      kiln_emission_directional(emission, i));
    if (lights->environment && !light_sky_is_constant(lights))
        sample_environment(c, v, surface);
}

/* ---- the chain ---- */

/* Traces the ray to the next surface; false: the chain has ended. */
static bool go_on(struct chain *c, const struct vertex *v, uint32_t surface, float pick, struct RTCRayHit *ray)
{
    const struct embree_backend *b = c->walk->b;
    struct vertex_way way;
    double numbers[4] = {(double)pick, 0.5};
    float tint[3] = {1.0f, 1.0f, 1.0f};
    walk_draw(c->walk, kiln_path_use(surface, KILN_PATH_BOUNCE), &numbers[2], &numbers[3]);
    if (!vertex_leave(b, v, false, v->m.others, numbers, &way))
        return false;
    multiply(c, way.factor);
    kiln_caustic_leave(&c->sums, way.cosine, way.forward, way.backward, way.delta);
    const bool meets = walk_trace(c->walk, vertex_start(v, way.direction), way.direction,
                                  kiln_path_use(surface, KILN_PATH_CHANCE), tint, ray);
    multiply(c, tint);
    if (!meets)
        meet_environment(c, v, way.direction);
    return meets && meeting_has_side(b, meeting_record(b, ray), meeting_is_back(ray));
}

void chain_follow_weighed(struct walk *walk, const struct kiln_caustic_techniques *techniques,
                          const struct kiln_caustic_gathered *sums, uint32_t chance, uint32_t k,
                          const struct RTCRayHit *ray, float light[3])
{
    const struct embree_backend *b = walk->b;
    struct chain c = {
        .walk = walk,
        .t = techniques,
        .weight = {1.0f, 1.0f, 1.0f},
        .sums = *sums,
        .light = light,
    };
    struct RTCRayHit next = *ray;
    struct vertex before;
    memset(light, 0, 3 * sizeof *light);
    walk->key = kiln_chain_key(chance);
    walk->k = k;
    for (uint32_t surface = 0;; surface++) {
        const struct kiln_vec3 direction = vec3(next.ray.dir_x, next.ray.dir_y, next.ray.dir_z);
        const bool goes_on = (meeting_record(b, &next)->material & KILN_RECORD_GLOSS) != 0;
        struct meeting m = goes_on ? meeting_begin(b, &next) : meeting_make(b, &next);
        const double cosine = fabs((double)vec3_dot(m.normal, direction));
        float share[3], pick;
        if (!(cosine > 0.0))
            return;
        kiln_caustic_arrive(&c.sums, (double)next.ray.tfar * (double)next.ray.tfar, cosine);
        if (goes_on && meeting_attenuation(&m, next.ray.tfar, share))
            multiply(&c, share);
        if (surface > 0)
            meet_emitter(&c, &before, &m, direction);
        if (!goes_on || !chain_survives(walk, &m, surface, c.weight, &pick))
            return;
        meeting_end(b, &next, &m);
        before = vertex_of(b, &m, direction);
        sample_lights(&c, &before, surface);
        if (!go_on(&c, &before, surface, pick, &next))
            return;
    }
}
