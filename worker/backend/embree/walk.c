#include "worker/backend/embree/walk.h"

#include <math.h>

#include "worker/backend/embree/light_samples.h"
#include "worker/backend/embree/shadow.h"
#include "worker/scene/texture.h"

void walk_draw(const struct walk *w, uint32_t use, double *u, double *v)
{
    uint32_t a, b;
    kiln_path_numbers(kiln_path_key(w->key, use), w->k, &a, &b);
    *u = kiln_unit_double(a);
    *v = kiln_unit_double(b);
}

bool walk_trace(const struct walk *w, struct kiln_vec3 origin, struct kiln_vec3 direction, uint32_t use, float tint[3],
                struct RTCRayHit *ray)
{
    *ray = (struct RTCRayHit){.ray = {.org_x = origin.x,
                                      .org_y = origin.y,
                                      .org_z = origin.z,
                                      .dir_x = direction.x,
                                      .dir_y = direction.y,
                                      .dir_z = direction.z,
                                      .tfar = INFINITY,
                                      .mask = ~0u},
                              .hit = {.geomID = RTC_INVALID_GEOMETRY_ID, .instID = {RTC_INVALID_GEOMETRY_ID}}};
    embree_nearest1(w->b, w->context, ray, kiln_hash2(kiln_path_key(w->key, use), w->k), tint);
    return ray->hit.geomID != RTC_INVALID_GEOMETRY_ID;
}

static void add(const float weight[3], const float rgb[3], float sum[3])
{
    for (int c = 0; c < 3; c++)
        sum[c] += weight[c] * rgb[c];
}

void walk_environment(const struct walk *w, struct kiln_vec3 direction, const float weight[3], float sum[3])
{
    float rgb[3];
    kiln_environment_radiance(w->b->params.lights, dvec3_of(direction), rgb);
    add(weight, rgb, sum);
}

void walk_emission(const struct walk *w, const struct meeting *m, const float weight[3], float sum[3])
{
    float rgb[3];
    if ((w->b->params.geometry->records[m->triangle].material & KILN_RECORD_EMITS) == 0)
        return;
    kiln_surface_emission(w->b->params.scene, m->mesh, m->stored, m->b1, m->b2, rgb);
    add(weight, rgb, sum);
}

/* ---- straight from the lights ---- */

static struct kiln_light_sample draw_light(const struct walk *w, const struct meeting *m, uint32_t surface,
                                           const struct kiln_light_choice *choice, uint32_t index, bool *good)
{
    const bool sky = choice->kind == KILN_CHOICE_ENVIRONMENT;
    struct kiln_light_sample sample = {0};
    double u = 0.5, v = 0.5, pick = 0.5, rest;
    if (choice->kind != KILN_CHOICE_DIRECTIONAL) {
        walk_draw(w, kiln_path_use(surface, sky ? KILN_PATH_SKY + index : KILN_PATH_LIGHT), &u, &v);
        walk_draw(w, kiln_path_use(surface, KILN_PATH_PICK), &pick, &rest);
    }
    *good = kiln_lights_sample(w->b->params.lights, choice, index, dvec3_of(m->position), dvec3_of(m->normal),
                               dvec3_of(m->shading), pick, u, v, &sample);
    return sample;
}

/* Computes the scattering of a sample's light towards the walk by `lobes`, times the cosine, at a surface that is not
 * only diffuse. Leaves out sharp lobes where rays or light paths find the light themselves. */
static void scatter(const struct walk *w, const struct meeting *m, const struct kiln_light_sample *sample,
                    uint32_t lobes, float scattered[3])
{
    const bool leaves = sample->has_extent || (w->leaves & KILN_LEAVES_POINTS) != 0;
    const struct kiln_bsdf_value f =
        meeting_evaluate(m, kiln_into_frame(&m->frame, vec3_of(sample->direction)), leaves ? lobes & ~m->sharp : lobes);
    scattered[0] = f.value.x;
    scattered[1] = f.value.y;
    scattered[2] = f.value.z;
}

/* Adds the light of one sample of a choice. */
static void add_sample(struct walk *w, const struct meeting *m, const struct kiln_light_choice *choice, uint32_t lobes,
                       struct kiln_light_sample *sample, const float weight[3], float sum[3])
{
    const double above = dvec3_dot(dvec3_of(m->normal), sample->direction),
                 cosine = dvec3_dot(dvec3_of(m->shading), sample->direction);
    const struct kiln_vec3 start = vec3_madd(m->position, m->normal, m->offset + m->lift);
    if (!(m->lifted || above > 0.0) || !(cosine > 0.0))
        return;
    w->rays++;
    shadow_aim(sample, dvec3_of(m->position), dvec3_of(start));
    if (!light_arrives(w->b, w->context, start, choice, sample))
        return;
    float rgb[3], scattered[3] = {0.0f, 0.0f, 0.0f};
    if (m->gloss != NULL)
        scatter(w, m, sample, lobes, scattered);
    for (int c = 0; c < 3; c++)
        rgb[c] = (float)(sample->value[c] * (m->gloss != NULL ? (double)scattered[c] : cosine * (1.0 / KILN_PI)));
    add(weight, rgb, sum);
}

void walk_lights(struct walk *w, const struct meeting *m, uint32_t surface, uint32_t lobes, const float weight[3],
                 float sum[3])
{
    const struct kiln_lights *lights = w->b->params.lights;
    const struct kiln_dvec3 n = m->lifted ? dvec3(0.0, 0.0, 0.0) : dvec3_of(m->normal); /* from below it, too */
    size_t count = kiln_lights_choices(lights, dvec3_of(m->position), 0.0, n, 1, w->choices);
    if (light_sky_is_constant(lights))
        count--; /* the environment is the last choice */
    for (size_t i = 0; i < count; i++) {
        struct kiln_light_choice *choice = &w->choices[i];
        choice->samples = choice->kind == KILN_CHOICE_ENVIRONMENT ? 2 : 1; /* by the cosine, and by luminance */
        for (uint32_t index = 0; index < choice->samples; index++) {
            bool good;
            struct kiln_light_sample sample = draw_light(w, m, surface, choice, index, &good);
            if (good)
                add_sample(w, m, choice, lobes, &sample, weight, sum);
        }
    }
}
