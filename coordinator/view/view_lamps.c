#include "coordinator/view/view_lamps.h"

#include <math.h>

#include "worker/base/arena.h"
#include "worker/base/memory.h"
#include "worker/light/emission.h"
#include "worker/scene/footprint.h"

/* A sample of a light at a place, and its shadow ray. */
struct shadow {
    uint32_t place;
    float length;    /* m: largest distance of an occluder */
    double value[3]; /* what it brings where nothing is */
};

struct kiln_view_lamps {
    const struct kiln_view_source *source;
    struct kiln_emission *emission; /* NULL: there are no lights */
    struct shadow *shadows;         /* shadow rays of all places; arrays below begin with those that are traced */
    uint32_t *traced;
    struct kiln_vec3 *origins, *directions;
    struct kiln_hit *hits;
    struct kiln_arena arena;
};

int kiln_view_lamps_create(struct kiln_view_lamps **lamps, const struct kiln_view_source *source, size_t capacity,
                           struct kiln_error *error)
{
    static const char *const what = "samples of lights of a view";
    int status = kiln_allocate(lamps, 1, sizeof **lamps, what, error);
    if (status != KILN_OK)
        return status;
    struct kiln_view_lamps *l = *lamps;
    l->source = source;
    if (source->lights != NULL)
        status = kiln_emission_create(&l->emission, source->lights, error);
    KILN_TRY(status);
    KILN_TRY(kiln_arena_allocate(&l->arena, &l->shadows, capacity, sizeof *l->shadows, what, error));
    KILN_TRY(kiln_arena_allocate(&l->arena, &l->traced, capacity, sizeof *l->traced, what, error));
    KILN_TRY(kiln_arena_allocate(&l->arena, &l->origins, capacity, sizeof *l->origins, what, error));
    KILN_TRY(kiln_arena_allocate(&l->arena, &l->directions, capacity, sizeof *l->directions, what, error));
    KILN_TRY(kiln_arena_allocate(&l->arena, &l->hits, capacity, sizeof *l->hits, what, error));
end:
    if (status != KILN_OK)
        kiln_view_lamps_destroy(lamps);
    return status;
}

void kiln_view_lamps_destroy(struct kiln_view_lamps **lamps)
{
    struct kiln_view_lamps *l = *lamps;
    if (l == NULL)
        return;
    kiln_emission_destroy(&l->emission);
    kiln_arena_release(&l->arena);
    kiln_free(lamps);
}

static struct kiln_dvec3 along(struct kiln_dvec3 from, struct kiln_dvec3 direction, double distance)
{
    return dvec3_add(from, dvec3_scale(direction, distance));
}

/* ---- weights ---- */

/* Whether the environment has an image, and is sampled. */
static bool has_image(const struct kiln_lights *lights) { return lights->environment && lights->conditional != NULL; }

static double share_of(double own, double other) { return own > 0.0 ? 1.0 / (1.0 + other / own * (other / own)) : 0.0; }

/* Normal for choosing lights, on the lit side; zero if both sides are lit. */
static struct kiln_dvec3 normal_of(const struct kiln_particle_place *p)
{
    return p->lobes.glass > 0.0f ? dvec3(0.0, 0.0, 0.0) : dvec3_of(vec3_scale(p->normal, p->hit.back ? -1.0f : 1.0f));
}

struct kiln_view_way kiln_view_way(const struct kiln_particle_place *place, const struct kiln_particle_turn *turn)
{
    return (struct kiln_view_way){.position = dvec3_of(place->position),
                                  .normal = normal_of(place),
                                  .density = turn->mirrored || kiln_particle_is_smooth(place) ? 0.0f : turn->density};
}

/* Probability density, per steradian, that one sample of the lights from way->position finds this place on the light.
 */
static double sampled_density(const struct kiln_emission *e, uint32_t light, const struct kiln_view_way *way,
                              struct kiln_dvec3 place, struct kiln_dvec3 direction)
{
    const struct kiln_lights *lights = e->lights;
    const struct kiln_dvec3 to = dvec3_sub(place, way->position), back = dvec3_scale(direction, -1.0);
    const double found = kiln_emission_connect(e, light, way->position, way->normal, place, back);
    if (light >= lights->area_count)
        return found;
    const double cosine = fabs(dvec3_dot(lights->areas[light].normal, direction));
    return cosine > 0.0 ? found * dvec3_dot(to, to) / cosine : 0.0;
}

double kiln_view_lamps_share(const struct kiln_view_lamps *lamps, const struct kiln_view_way *way,
                             const struct kiln_hit *hit, struct kiln_vec3 direction)
{
    const struct kiln_emission *e = lamps->emission;
    const struct kiln_dvec3 d = dvec3_of(direction);
    uint32_t light;
    struct kiln_dvec3 place = way->position;
    if (e == NULL || !(way->density > 0.0f))
        return 1.0;
    if (hit->triangle == KILN_NONE) {
        if (!has_image(e->lights))
            return 1.0;
        light = kiln_emission_environment(e);
    } else {
        light = kiln_emission_at(e, hit->triangle, (double)hit->u, (double)hit->v);
        if (light == KILN_NONE || (hit->back && !e->lights->areas[light].two_sided))
            return 1.0;
        place = dvec3_of(kiln_triangle_position(lamps->source->geometry, hit->triangle, hit->u, hit->v));
    }
    return share_of((double)way->density, sampled_density(e, light, way, place, d));
}

/* ---- samples ---- */

/* Rounds of samples: one of the tree, one of each directional light, one of the environment. */
static size_t rounds_of(const struct kiln_lights *lights) { return 1 + lights->directional_count + 1; }

static bool draw_environment(const struct kiln_lights *lights, const struct kiln_particle_chance *chance,
                             struct kiln_light_sample *sample)
{
    double u, v, density;
    float rgb[3];
    kiln_particle_draw(chance, KILN_PATH_SKY, &u, &v);
    *sample = (struct kiln_light_sample){
        .direction = kiln_environment_sample(lights, u, v, &density), .distance = (double)INFINITY, .has_extent = true};
    kiln_environment_radiance(lights, sample->direction, rgb);
    for (int c = 0; c < 3; c++)
        sample->value[c] = (double)rgb[c] / density;
    return density > 0.0;
}

/* Draws a sample of a round. `light`: index of its light. False: no sample. */
static bool draw_sample(const struct kiln_emission *e, size_t round, const struct kiln_view_lit *lit,
                        const struct kiln_view_way *way, struct kiln_light_sample *sample, uint32_t *light)
{
    const struct kiln_lights *lights = e->lights;
    struct kiln_light_choice choice = {.kind = KILN_CHOICE_LIGHT_NODE, .samples = 1};
    double u = 0.5, v = 0.5, pick = 0.5, rest;
    if (round > lights->directional_count) {
        *light = kiln_emission_environment(e);
        return has_image(lights) && draw_environment(lights, &lit->chance, sample);
    }
    if (round > 0) {
        choice.kind = KILN_CHOICE_DIRECTIONAL;
        choice.index = (uint32_t)(round - 1);
        *light = kiln_emission_directional(e, round - 1);
    } else {
        kiln_particle_draw(&lit->chance, KILN_PATH_LIGHT, &u, &v);
        kiln_particle_draw(&lit->chance, KILN_PATH_PICK, &pick, &rest);
    }
    if ((round == 0 && lights->node_count == 0) ||
        !kiln_lights_sample(lights, &choice, 0, way->position, way->normal, way->normal, pick, u, v, sample))
        return false;
    *light = round == 0 ? sample->light : *light;
    return true;
}

/* Attenuates light that comes to a surface from within its body of glass. */
static void attenuate(const struct kiln_particle_place *p, const struct kiln_light_sample *sample, double value[3])
{
    float share[3];
    if ((p->gloss->flags & KILN_GLOSS_VOLUME) == 0 || !isfinite(sample->distance) ||
        !(dvec3_dot(dvec3_of(p->normal), sample->direction) < 0.0))
        return;
    kiln_gloss_attenuation(p->gloss, (float)sample->distance, share);
    for (int c = 0; c < 3; c++)
        value[c] *= (double)share[c];
}

/* Draws a sample of a round for a place, with its shadow ray; false: it contributes nothing. */
static bool prepare(const struct kiln_view_lamps *lamps, size_t round, const struct kiln_view_lit *lit,
                    struct shadow *shadow, struct kiln_vec3 *origin, struct kiln_vec3 *direction)
{
    const struct kiln_view_way way = {.position = dvec3_of(lit->place.position), .normal = normal_of(&lit->place)};
    struct kiln_light_sample sample;
    uint32_t light;
    if (!draw_sample(lamps->emission, round, lit, &way, &sample, &light))
        return false;
    const struct kiln_vec3 towards = vec3_of(sample.direction);
    const struct kiln_bsdf_value f = kiln_particle_scatter(&lit->place, towards);
    const float scattered[3] = {f.value.x, f.value.y, f.value.z};
    if (!(scattered[0] > 0.0f || scattered[1] > 0.0f || scattered[2] > 0.0f))
        return false;
    double share = 1.0;
    if (sample.has_extent) {
        const struct kiln_dvec3 place =
            isfinite(sample.distance) ? along(way.position, sample.direction, sample.distance) : way.position;
        share = share_of(sampled_density(lamps->emission, light, &way, place, sample.direction),
                         (double)kiln_view_guide_density(&lit->guide, &lit->place, towards, f.density));
    }
    for (int c = 0; c < 3; c++)
        shadow->value[c] =
            share * sample.value[c] * (double)scattered[c] * (double)(lit->weight[c] * lit->place.arrives[c]);
    attenuate(&lit->place, &sample, shadow->value);
    shadow->length = kiln_particle_shadow(&lit->place, &sample, origin, direction);
    return share > 0.0;
}

/* Adds the samples of one round; those that can contribute are traced together. */
static int add_round(struct kiln_view_lamps *lamps, size_t round, struct kiln_view_lit *places, size_t count,
                     struct kiln_error *error)
{
    size_t traced = 0;
#pragma omp parallel for schedule(dynamic, 256)
    for (size_t i = 0; i < count; i++)
        lamps->traced[i] =
            !kiln_particle_is_smooth(&places[i].place) &&
            prepare(lamps, round, &places[i], &lamps->shadows[i], &lamps->origins[i], &lamps->directions[i]);
    for (size_t i = 0; i < count; i++) {
        if (lamps->traced[i] == 0)
            continue;
        lamps->shadows[traced] = lamps->shadows[i];
        lamps->shadows[traced].place = (uint32_t)i;
        lamps->origins[traced] = lamps->origins[i];
        lamps->directions[traced++] = lamps->directions[i];
    }
    if (traced == 0)
        return KILN_OK;
    const int status =
        kiln_backend_intersect(lamps->source->backend, lamps->origins, lamps->directions, traced, lamps->hits, error);
    for (size_t i = 0; i < traced && status == KILN_OK; i++) {
        const struct shadow *shadow = &lamps->shadows[i];
        const struct kiln_hit *hit = &lamps->hits[i];
        if (hit->triangle != KILN_NONE && hit->distance < shadow->length)
            continue;
        for (int c = 0; c < 3; c++)
            places[shadow->place].rgb[c] += (float)(shadow->value[c] * (double)hit->tint[c]);
    }
    return status;
}

int kiln_view_lamps_add(struct kiln_view_lamps *lamps, struct kiln_view_lit *places, size_t count,
                        struct kiln_error *error)
{
    int status = KILN_OK;
    if (lamps->emission == NULL)
        return KILN_OK;
    for (size_t round = 0; round < rounds_of(lamps->emission->lights) && status == KILN_OK; round++)
        status = add_round(lamps, round, places, count, error);
    return status;
}
