/* A lone area light as all places of one surface point see it: what its samples have in common is reckoned once a
 * point, and samples are drawn several at a time.
 *
 * A sample is a place on the light, chosen as the point's centre c would choose it: evenly in solid angle
 * (shaders/shared/spherical_triangle.h), or evenly in area where the light is small. Its density is known for any other
 * place p,
 *
 *     density of the direction from p = |y - p|^2 / cos_p  x  cos_c / (omega |y - c|^2)
 *
 * with y the place on the light, omega the solid angle from c, the cosines those at the light. Places must be near c
 * compared with the light's plane, so that densities stay close to even, and corners of the light not opposite each
 * other as c sees them, so that floats do (shaders/area_light_sampler.glsl); for others there is kiln_lights_sample.
 * Pure and thread-safe. */
#ifndef KILN_WORKER_LIGHT_AREA_LIGHT_SAMPLER_H
#define KILN_WORKER_LIGHT_AREA_LIGHT_SAMPLER_H

#include "shaders/shared/area_sampler.h"
#include "worker/light/lights.h"

enum { KILN_TARGET_LANES = 8 };

struct kiln_area_light_sampler {
    const struct kiln_area_light *light;
    struct kiln_dvec3 centre;
    struct kiln_area_view view;
};

/* Samples in structures of arrays; all lanes are reckoned, whether used or not. */
struct kiln_area_light_samples {
    double u[KILN_TARGET_LANES], v[KILN_TARGET_LANES]; /* in: random, in (0, 1) */
    double place[3][KILN_TARGET_LANES];                /* in: where the light is seen from */
    double to[3][KILN_TARGET_LANES];                   /* m: from there to the sample */
    double distance[KILN_TARGET_LANES];
    double weight[KILN_TARGET_LANES];                    /* sr: 1 / density of the direction; 0: it brings nothing */
    double backoff[KILN_TARGET_LANES];                   /* m, as in struct kiln_light_sample */
    double b1[KILN_TARGET_LANES], b2[KILN_TARGET_LANES]; /* on the light; of textured ones only */
};

/* Makes a choice ready for a point within `spread` metres of the centre; false where it is none for this: a cluster,
 * another kind of light, seen from behind, or too near. */
bool kiln_area_light_sampler(const struct kiln_lights *lights, const struct kiln_light_choice *choice,
                             struct kiln_dvec3 centre, double spread, struct kiln_area_light_sampler *target);

void kiln_area_light_sampler_draw(const struct kiln_area_light_sampler *target,
                                  struct kiln_area_light_samples *samples);

#endif
