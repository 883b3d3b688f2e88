/* Samples of lights where light from all directions counts alike: at probes, and for light by direction at surface
 * points. A constant sky is left out: rays over the sphere or the hemisphere meet it. */
#ifndef KILN_WORKER_BACKEND_EMBREE_LIGHT_SAMPLES_H
#define KILN_WORKER_BACKEND_EMBREE_LIGHT_SAMPLES_H

#include "worker/backend/embree/passage.h"
#include "worker/light/lights.h"

/* Whether the environment is a sky of one radiance all over. */
static inline bool light_sky_is_constant(const struct kiln_lights *lights)
{
    return lights->environment && lights->conditional == NULL;
}

/* How many choices there may be. */
static inline size_t light_choices_room(const struct kiln_lights *lights)
{
    return KILN_CUT_MAX + lights->directional_count + 1;
}

/* Chooses at most `limit` lights of the tree, and the others, for places within `spread` metres of p with normal n (see
 * kiln_lights_choices), and shares out the samples among them. Returns how many choices there are; `choices` holds
 * light_choices_room of them. */
size_t light_choose(const struct kiln_lights *lights, struct kiln_dvec3 p, double spread, struct kiln_dvec3 n,
                    size_t limit, uint32_t samples, struct kiln_light_choice *choices);

/* What the random numbers of a choice's samples hang on, for a probe or texel with this key. */
uint32_t light_identity(uint32_t key, const struct kiln_light_choice *choice);

/* Draws sample k of a choice, seen from p. False when it brings nothing. */
bool light_draw(const struct kiln_lights *lights, const struct kiln_light_choice *choice, uint32_t identity, uint32_t k,
                struct kiln_dvec3 p, struct kiln_light_sample *sample);

/* Traces the sample's shadow ray from `start`. False: nothing comes through; else the sample's value becomes radiance x
 * solid angle of its part of the choice's samples. */
bool light_arrives(const struct embree_backend *b, struct embree_context *context, struct kiln_vec3 start,
                   const struct kiln_light_choice *choice, struct kiln_light_sample *sample);

#endif
