#include "worker/backend/embree/chain_weighed.h"

#include <math.h>
#include <string.h>

#include "worker/backend/embree/shadow.h"
#include "worker/backend/embree/techniques.h"

/* A chain under way. */
struct chain {
    struct walk *walk;
    const struct kiln_caustic_techniques *t;
    float weight[3]; /* what of the radiance that comes now reaches the chain's begin */
    struct kiln_caustic_gathered sums;
    const struct kiln_caustic_factors *factors;
    struct chain_weighed *found;
    float *light[KILN_CAUSTIC_GATHERS]; /* in `found` */
};

static void multiply(struct chain *c, const float factor[3])
{
    for (int i = 0; i < 3; i++)
        c->weight[i] *= factor[i];
}

/* A path's weight, and what it would have more of with each exchange. */
struct weight {
    double by, more[KILN_CAUSTIC_EXCHANGES];
};

static const struct weight whole = {1.0, {0.0}};

static bool exchanges(const struct chain *c) { return c->t->mis == KILN_MIS_OPTIMAL; }

static void weigh(const struct chain *c, const struct weight *w, float weight[3])
{
    const bool pilot = c->found->pilot;
    const double by = !exchanges(c) ? pilot ? 1.0 : w->by
                      : pilot       ? w->by
                                    : kiln_caustic_exchanged(c->factors, w->by, w->more);
    for (int i = 0; i < 3; i++)
        weight[i] = (float)((double)c->weight[i] * by);
}

/* A technique has found light by this weight; `before`: what it had found. */
static void note_exchanges(const struct chain *c, enum kiln_caustic_gathers technique, const struct weight *w,
                           const float before[3])
{
    const double light = (double)(kiln_luminance_in_float(c->light[technique]) - kiln_luminance_in_float(before));
    for (int e = 0; e < KILN_CAUSTIC_EXCHANGES && exchanges(c); e++)
        c->found->exchanged[e] += light * w->more[e];
}

/* ---- lights that the chain meets ---- */

/* `before`: the surface that the chain has come from. */
static struct weight weigh_hit(const struct chain *c, const struct vertex *before, uint32_t light,
                               struct kiln_dvec3 place, struct kiln_dvec3 direction)
{
    const double connect = techniques_connect(c->t, light, before, place, direction) * (double)c->factors->sample,
                 emission = techniques_emission(c->t, light, before, place, direction);
    struct weight w = {kiln_caustic_weight_hit(c->t->mis, &c->sums, connect, emission), {0.0}};
    if (exchanges(c))
        kiln_caustic_exchange_hit(&c->sums, w.by, connect, emission, w.more);
    return w;
}

static void meet_emitter(struct chain *c, const struct vertex *before, const struct meeting *m,
                         struct kiln_vec3 direction)
{
    const struct kiln_emission *emission = c->t->emission;
    const uint32_t light = kiln_emission_of_triangle(emission, m->triangle);
    struct weight w = whole;
    float weight[3], found[3];
    if (light != KILN_NONE && !(m->back && !emission->lights->areas[light].two_sided)) {
        const struct kiln_vec3 place = kiln_triangle_position(c->walk->b->params.geometry, m->triangle, m->u, m->v);
        w = weigh_hit(c, before, light, dvec3_of(place), dvec3_of(vec3_scale(direction, -1.0f)));
    }
    weigh(c, &w, weight);
    memcpy(found, c->light[KILN_CAUSTIC_HIT], sizeof found);
    walk_emission(c->walk, m, weight, c->light[KILN_CAUSTIC_HIT]);
    note_exchanges(c, KILN_CAUSTIC_HIT, &w, found);
}

static void meet_environment(struct chain *c, const struct vertex *before, struct kiln_vec3 direction)
{
    const struct kiln_emission *emission = c->t->emission;
    const struct kiln_dvec3 from = dvec3_of(vec3_scale(direction, -1.0f));
    float weight[3], found[3];
    if (!emission->lights->environment)
        return;
    const struct weight w = weigh_hit(c, before, kiln_emission_environment(emission), from, from);
    weigh(c, &w, weight);
    memcpy(found, c->light[KILN_CAUSTIC_HIT], sizeof found);
    walk_environment(c->walk, direction, weight, c->light[KILN_CAUSTIC_HIT]);
    note_exchanges(c, KILN_CAUSTIC_HIT, &w, found);
}

/* ---- samples of lights ---- */

/* What a sample at surface number `surface` brings: `light` is its number among all. */
static void add_sample(struct chain *c, const struct vertex *v, uint32_t surface,
                       const struct kiln_light_choice *choice, uint32_t light, struct kiln_light_sample *sample)
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
    float weight[3], found[3];
    if (!vertex_scatter(b, v, v->from, direction, v->m.others, &s))
        return;
    const double connect = techniques_connect(c->t, light, v, end, down) * (double)c->factors->sample,
                 emission = techniques_emission(c->t, light, v, end, down);
    c->walk->rays++;
    shadow_aim(sample, place, dvec3_of(start));
    if (!(connect > 0.0) || !light_arrives(b, c->walk->context, start, choice, sample))
        return;
    const double hit = sample->has_extent ? s.to_light * cosine / squared : 0.0;
    const double towards = s.cosine_i / squared;
    struct weight w = {
        kiln_caustic_weight_sampled(c->t->mis, &c->sums, surface == 0, connect, emission, towards, hit, s.to_eye),
        {0.0}};
    if (exchanges(c))
        kiln_caustic_exchange_sampled(&c->sums, w.by, connect, emission, towards, hit, s.to_eye, w.more);
    weigh(c, &w, weight);
    memcpy(found, c->light[KILN_CAUSTIC_SAMPLE], sizeof found);
    if (!outside)
        vertex_attenuate(v, direction, (float)sample->distance, weight);
    for (int i = 0; i < 3; i++)
        c->light[KILN_CAUSTIC_SAMPLE][i] += weight[i] * (float)(sample->value[i] * s.all[i] * s.cosine_i);
    note_exchanges(c, KILN_CAUSTIC_SAMPLE, &w, found);
}

static void sample_choice(struct chain *c, const struct vertex *v, uint32_t surface, struct kiln_light_choice choice,
                          uint32_t light)
{
    const bool tree = choice.kind == KILN_CHOICE_NODE;
    const struct kiln_dvec3 n = subpaths_light_normal(v);
    struct kiln_light_sample sample = {0};
    double u = 0.5, w = 0.5, pick = 0.5, rest;
    if (tree) {
        walk_draw(c->walk, kiln_path_use(surface, KILN_PATH_LIGHT), &u, &w);
        walk_draw(c->walk, kiln_path_use(surface, KILN_PATH_PICK), &pick, &rest);
    }
    if (kiln_lights_sample(c->t->emission->lights, &choice, 0, dvec3_of(v->m.position), n, n, pick, u, w, &sample))
        add_sample(c, v, surface, &choice, tree ? sample.light : light, &sample);
}

/* By luminance alone: rays of the chain find the rest. */
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
    add_sample(c, v, surface, &choice, kiln_emission_environment(c->t->emission), &sample);
}

static void sample_lights(struct chain *c, const struct vertex *v, uint32_t surface)
{
    const struct kiln_emission *emission = c->t->emission;
    const struct kiln_lights *lights = emission->lights;
    if (vertex_is_smooth(v))
        return;
    if (lights->node_count > 0)
        sample_choice(c, v, surface, (struct kiln_light_choice){.kind = KILN_CHOICE_NODE, .samples = 1}, KILN_NONE);
    for (size_t i = 0; i < lights->directional_count; i++)
        sample_choice(c, v, surface,
                      (struct kiln_light_choice){.kind = KILN_CHOICE_DIRECTIONAL, .index = (uint32_t)i, .samples = 1},
                      kiln_emission_directional(emission, i));
    if (lights->environment && !light_sky_is_constant(lights))
        sample_environment(c, v, surface);
}

/* ---- the chain ---- */

/* The ray goes on to the next surface; false: the chain has ended. */
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
    kiln_caustic_leave(&c->sums, surface == 0, way.cosine, way.forward, way.backward, way.delta);
    const bool meets = walk_trace(c->walk, vertex_start(v, way.direction), way.direction,
                                  kiln_path_use(surface, KILN_PATH_CHANCE), tint, ray);
    multiply(c, tint);
    if (!meets)
        meet_environment(c, v, way.direction);
    return meets && meeting_has_side(b, meeting_record(b, ray), meeting_is_back(ray));
}

void chain_follow_weighed(struct walk *walk, const struct kiln_caustic_techniques *techniques,
                          const struct kiln_caustic_gathered *sums, const struct kiln_caustic_factors *factors,
                          uint32_t chance, uint32_t k, const struct RTCRayHit *ray, struct chain_weighed *found)
{
    const struct embree_backend *b = walk->b;
    struct chain c = {
        .walk = walk,
        .t = techniques,
        .weight = {1.0f, 1.0f, 1.0f},
        .sums = *sums,
        .factors = factors,
        .found = found,
        .light = {found->light[KILN_CAUSTIC_HIT], found->light[found->pilot ? KILN_CAUSTIC_SAMPLE : KILN_CAUSTIC_HIT]}};
    struct RTCRayHit next = *ray;
    struct vertex before;
    *found = (struct chain_weighed){.pilot = found->pilot};
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
        kiln_caustic_arrive(&c.sums, surface == 0, (double)next.ray.tfar * (double)next.ray.tfar, cosine);
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
