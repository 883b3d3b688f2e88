/* Importance of a cluster of lights at a point: an estimate of the light that it brings. Samples are distributed by it.
 *
 * Conty Estevez and Kulla, "Importance Sampling of Many Lights with Adaptive Tree Splitting", 2018, section 4; bounds
 * as in pbrt-v4, section 12.6. Importance is zero only where the cluster surely brings no light. */
#ifndef KILN_SHADERS_SHARED_LIGHT_IMPORTANCE_H
#define KILN_SHADERS_SHARED_LIGHT_IMPORTANCE_H

#include "shaders/shared/real.h"

#define KILN_CUT_MAX 24u /* maximum number of clusters in a point's cut through the light tree */

/* Maximum number of clusters for a point with `samples` light samples: two samples a cluster. */
KILN_FUNCTION KILN_U32 kiln_cut_limit(KILN_U32 samples) { return word_max(1u, word_min(samples / 2u, KILN_CUT_MAX)); }

/* A cluster with at most this share of the total importance at a point is not split: one sample is enough for it. The
 * share is small because the seemingly important lights may be hidden from the point. */
#define KILN_CUT_SHARE KILN_RATIO(1, 1048576)

/* Bounds of a cluster: position, directions of emission, power. */
struct kiln_light_bounds {
    kiln_real3 centre, axis;       /* m; unit */
    kiln_real radius;              /* m: half the diagonal of its box */
    kiln_real floor2;              /* m2: radius^2 / 4, minimum of the squared distance */
    kiln_real cos_o, sin_o, cos_e; /* spread of normals about the axis; emission beyond it */
    kiln_real power;               /* luminance of radiance x area, or of intensity */
    bool two_sided, shines;        /* shines: power > 0, before it was rounded to kiln_real */
};

/* Whether n is zero, which stands for every direction: a probe, or a point with several normals. */
KILN_FUNCTION bool kiln_any_direction(kiln_real3 n) { return n.x == 0 && n.y == 0 && n.z == 0; }

KILN_FUNCTION kiln_real kiln_sine_of_cosine(kiln_real c) { return real_sqrt(real_max(kiln_real_of(0), 1 - c * c)); }

/* kiln_cosine_less: cos(max(0, a - b)); kiln_sine_less: sin(max(0, a - b)); from cosines and sines of a and b. */
KILN_FUNCTION kiln_real kiln_cosine_less(kiln_real sin_a, kiln_real cos_a, kiln_real sin_b, kiln_real cos_b)
{
    return cos_a > cos_b ? kiln_real_of(1) : cos_a * cos_b + sin_a * sin_b;
}
KILN_FUNCTION kiln_real kiln_sine_less(kiln_real sin_a, kiln_real cos_a, kiln_real sin_b, kiln_real cos_b)
{
    return cos_a > cos_b ? kiln_real_of(0) : sin_a * cos_b - cos_a * sin_b;
}

/* Estimates the irradiance that the cluster brings to points within `spread` metres of p (normal n; n = 0: any): a
 * bound of power x cosines over squared distance. The inverse square holds beyond the cluster's own size; within it the
 * light cannot fill more than a hemisphere. */
KILN_FUNCTION kiln_real kiln_light_importance(KILN_STRUCT kiln_light_bounds b, kiln_real3 p, kiln_real spread,
                                              kiln_real3 n)
{
    const kiln_real radius = b.radius + spread, radius2 = radius * radius;
    const kiln_real3 away = real3_sub(p, b.centre); /* from the cluster to the point */
    const kiln_real d2 = real3_dot(away, away);
    kiln_real emission = 1, reception = 1;
    if (d2 > radius2) {
        const kiln_real cos_b = real_sqrt(real_max(kiln_real_of(0), 1 - radius2 / d2)),
                        sin_b = kiln_sine_of_cosine(cos_b);
        const kiln_real3 w = real3_scale(away, 1 / real_sqrt(d2));
        kiln_real cos_w = real3_dot(b.axis, w);
        if (b.two_sided)
            cos_w = real_abs(cos_w);
        const kiln_real sin_w = kiln_sine_of_cosine(cos_w);
        const kiln_real cos_x = kiln_cosine_less(sin_w, cos_w, b.sin_o, b.cos_o),
                        sin_x = kiln_sine_less(sin_w, cos_w, b.sin_o, b.cos_o);
        emission = kiln_cosine_less(sin_x, cos_x, sin_b, cos_b);
        if (emission <= b.cos_e)
            return kiln_real_of(0);
        if (!kiln_any_direction(n)) {
            const kiln_real cos_i = -real3_dot(n, w);
            reception = kiln_cosine_less(kiln_sine_of_cosine(cos_i), cos_i, sin_b, cos_b);
            if (reception <= 0)
                return kiln_real_of(0);
        }
    }
    const kiln_real least = KILN_RATIO(1, 1000);
    const kiln_real importance =
        b.power * real_max(emission, least) * real_max(reception, least) / real_max(d2, b.floor2);
    return importance > 0 && !real_is_infinite(importance) ? importance : b.shines ? KILN_REAL_TINY : kiln_real_of(0);
}

/* Importance of a directional light with luminance `luminance`, W/m2. `cosine`: with the normal, 1 for any direction.
 * 0: the light is behind the point. */
KILN_FUNCTION kiln_real kiln_sun_importance(kiln_real luminance, kiln_real cosine)
{
    return cosine > 0 ? luminance * cosine : kiln_real_of(0);
}

/* Importance of an environment; `luminance` is that of its mean radiance. */
KILN_FUNCTION kiln_real kiln_sky_importance(kiln_real luminance) { return KILN_REAL_PI * luminance; }

/* Number of samples of a choice whose share of the total importance is `part`. */
KILN_FUNCTION KILN_U32 kiln_choice_samples(kiln_real part, KILN_U32 samples)
{
    return word_max(1u, KILN_TO_U32(part * kiln_real_of(samples) + KILN_RATIO(1, 2)));
}

/* Takes one step down the light tree: to the left with probability `chance`. `pick` in (0, 1) is a random number, and
 * is rescaled to one. `weight` is 1 / probability of the path so far. Returns whether it goes left. */
KILN_FUNCTION bool kiln_light_tree_step(kiln_real chance, KILN_INOUT(kiln_real) pick, KILN_INOUT(kiln_real) weight)
{
    const bool left = KILN_AT(pick) < chance;
    KILN_AT(pick) = left ? KILN_AT(pick) / chance : (KILN_AT(pick) - chance) / (1 - chance);
    KILN_AT(weight) /= left ? chance : 1 - chance;
    KILN_AT(pick) = real_min(KILN_AT(pick), KILN_REAL_BELOW_ONE);
    return left;
}

#endif
