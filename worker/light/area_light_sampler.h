/* Sampler of one area light for all places of one surface point. Values common to its samples are computed once a
 * point, and samples are drawn several at a time (SIMD).
 *
 * A sample is a place on the light, drawn as for the point's centre c: evenly in solid angle
 * (shaders/shared/spherical_triangle.h), or evenly in area where the light is small. Seen from any other place p, its
 * density is
 *
 *     density of the direction from p = |y - p|^2 / cos_p  x  cos_c / (omega |y - c|^2)
 *
 * with y the place on the light, omega the solid angle from c, the cosines those at the light. Two conditions hold.
 * Places must be closer to c than to the light's plane by far, so that the density stays almost even. Corners of the
 * light must not lie in opposite directions from c, so that floats suffice (shaders/area_light_sampler.glsl). In all
 * other cases use kiln_lights_sample. Pure and thread-safe. */
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

/* Samples as a structure of arrays; all lanes are computed, used or not. */
struct kiln_area_light_samples {
    double u[KILN_TARGET_LANES], v[KILN_TARGET_LANES]; /* in: random, in (0, 1) */
    double place[3][KILN_TARGET_LANES];                /* in: where the light is seen from */
    double to[3][KILN_TARGET_LANES];                   /* m: from there to the sample */
    double distance[KILN_TARGET_LANES];
    double weight[KILN_TARGET_LANES];                    /* sr: 1 / density of the direction; 0: it brings nothing */
    double backoff[KILN_TARGET_LANES];                   /* m, as in struct kiln_light_sample */
    double b1[KILN_TARGET_LANES], b2[KILN_TARGET_LANES]; /* on the light; of textured ones only */
};

/* Prepares the sampler of a choice for a point within `spread` metres of the centre. Returns false if this sampler
 * cannot be used: the choice is a cluster or another kind of light, or the light is seen from behind or too near. */
bool kiln_area_light_sampler(const struct kiln_lights *lights, const struct kiln_light_choice *choice,
                             struct kiln_dvec3 centre, double spread, struct kiln_area_light_sampler *target);

void kiln_area_light_sampler_draw(const struct kiln_area_light_sampler *target,
                                  struct kiln_area_light_samples *samples);

#endif
