/* Sampling of lights where all directions count alike: at probes, and for light by direction at surface points. A
 * constant sky is left out, as rays over the sphere or hemisphere hit it. */
#ifndef KILN_WORKER_BACKEND_EMBREE_LIGHT_SAMPLES_H
#define KILN_WORKER_BACKEND_EMBREE_LIGHT_SAMPLES_H

#include <math.h>

#include "shaders/shared/area_light.h"
#include "shaders/shared/streams.h"
#include "worker/backend/embree/passage.h"
#include "worker/light/lights.h"
#include "worker/sampling/sequence.h"

/* Whether the environment is a sky of one radiance all over. */
static inline bool light_sky_is_constant(const struct kiln_lights *lights)
{
    return lights->environment && lights->conditional == NULL;
}

/* Largest number of choices. */
static inline size_t light_choices_room(const struct kiln_lights *lights)
{
    return KILN_CUT_MAX + lights->directional_count + 1;
}

/* Chooses at most `limit` clusters of the light tree, and the other lights, for places within `spread` metres of p with
 * normal n (see kiln_lights_choices), and distributes the samples among them. Returns the number of choices; `choices`
 * has room for light_choices_room. */
static inline size_t light_choose(const struct kiln_lights *lights, struct kiln_dvec3 p, double spread,
                                  struct kiln_dvec3 n, size_t limit, uint32_t samples,
                                  struct kiln_light_choice *choices)
{
    size_t count = kiln_lights_choices(lights, p, spread, n, limit, choices);
    if (light_sky_is_constant(lights))
        count--; /* the environment is the last choice */
    (void)kiln_lights_allot(choices, count, samples);
    return count;
}

/* Returns the seed of a choice's samples, for a probe or texel with this key. */
static inline uint32_t light_identity(uint32_t key, const struct kiln_light_choice *choice)
{
    return kiln_hash2(key, kiln_choice_identity((uint32_t)choice->kind, choice->index));
}

/* Returns a random number of sample k; each dimension has its own scramble. */
static inline double light_number(uint32_t identity, uint32_t k, uint32_t dimension, uint32_t scramble)
{
    return kiln_unit_double(kiln_owen_scramble(kiln_sobol(k, dimension), kiln_hash2(identity, scramble)));
}

/* Draws sample k of a choice, seen from p. False: the sample brings no light. */
static inline bool light_draw(const struct kiln_lights *lights, const struct kiln_light_choice *choice,
                              uint32_t identity, uint32_t k, struct kiln_dvec3 p, struct kiln_light_sample *sample)
{
    const double u = light_number(identity, k, KILN_DIMENSION_U, 0), v = light_number(identity, k, KILN_DIMENSION_V, 1),
                 pick = light_number(identity, k, KILN_DIMENSION_CHOICE, 2);
    const struct kiln_dvec3 any = dvec3(0.0, 0.0, 0.0);
    return kiln_lights_sample(lights, choice, k, p, any, any, pick, u, v, sample);
}

/* Traces the sample's shadow ray from `start`. False: blocked. Else the sample's value becomes radiance x solid angle /
 * number of the choice's samples. */
static inline bool light_arrives(const struct embree_backend *b, struct embree_context *context, struct kiln_vec3 start,
                                 const struct kiln_light_choice *choice, struct kiln_light_sample *sample)
{
    struct RTCRay ray = {.org_x = start.x,
                         .org_y = start.y,
                         .org_z = start.z,
                         .dir_x = (float)sample->direction.x,
                         .dir_y = (float)sample->direction.y,
                         .dir_z = (float)sample->direction.z,
                         .mask = ~0u,
                         .tfar = isfinite(sample->distance)
                                     ? (float)((sample->distance - sample->backoff) * KILN_SHADOW_LENGTH)
                                     : INFINITY};
    double through[3] = {1.0, 1.0, 1.0};
    embree_through1(b, context, &ray, through);
    if (ray.tfar < 0.0f)
        return false;
    for (int c = 0; c < 3; c++)
        sample->value[c] *= through[c] / choice->samples;
    return true;
}

#endif
