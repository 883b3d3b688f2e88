#include "worker/backend/embree/light_samples.h"

#include <math.h>

#include "shaders/shared/area_light.h"
#include "shaders/shared/streams.h"
#include "worker/sampling/sequence.h"

size_t light_choose(const struct kiln_lights *lights, struct kiln_dvec3 p, double spread, struct kiln_dvec3 n,
                    size_t limit, uint32_t samples, struct kiln_light_choice *choices)
{
    size_t count = kiln_lights_choices(lights, p, spread, n, limit, choices);
    if (light_sky_is_constant(lights))
        count--; /* the environment is the last choice */
    (void)kiln_lights_allot(choices, count, samples);
    return count;
}

uint32_t light_identity(uint32_t key, const struct kiln_light_choice *choice)
{
    return kiln_hash2(key, kiln_choice_identity((uint32_t)choice->kind, choice->index));
}

/* A random number of sample k; each has a scramble of its own. */
static double number(uint32_t identity, uint32_t k, uint32_t dimension, uint32_t scramble)
{
    return kiln_unit_double(kiln_owen_scramble(kiln_sobol(k, dimension), kiln_hash2(identity, scramble)));
}

bool light_draw(const struct kiln_lights *lights, const struct kiln_light_choice *choice, uint32_t identity, uint32_t k,
                struct kiln_dvec3 p, struct kiln_light_sample *sample)
{
    const double u = number(identity, k, KILN_DIMENSION_U, 0), v = number(identity, k, KILN_DIMENSION_V, 1),
                 pick = number(identity, k, KILN_DIMENSION_CHOICE, 2);
    const struct kiln_dvec3 any = dvec3(0.0, 0.0, 0.0);
    return kiln_lights_sample(lights, choice, k, p, any, pick, u, v, sample);
}

bool light_arrives(const struct embree_backend *b, struct embree_context *context, struct kiln_vec3 start,
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
