/* Environment light: a piecewise constant lat-long image, sampled by luminance x sin(theta). Rows are sampled by the
 * cumulative distribution `marginal`, columns by that of their row in `conditional`. Column 0 begins at -z turned by
 * half a turn and `rotation`, radians about +y; row 0 is about +y.
 *
 * GLSL must define before KILN_FLOATS, the type of an array of floats, and KILN_FLOAT_OF(array, i). */
#ifndef KILN_SHADERS_SHARED_ENVIRONMENT_H
#define KILN_SHADERS_SHARED_ENVIRONMENT_H

#include "shaders/shared/sphere.h"

#ifndef KILN_GLSL
#    define KILN_FLOATS const float *
#    define KILN_FLOAT_OF(array, i) array[i]
#    define KILN_INDEX size_t
#    define KILN_TO_INDEX(i) ((size_t)(i))
#else
#    define KILN_INDEX uint
#    define KILN_TO_INDEX(i) (i)
#endif

KILN_FUNCTION KILN_U32 kiln_sky_column(kiln_real3 d, kiln_real rotation, KILN_U32 width)
{
    kiln_real u = KILN_RATIO(1, 2) + (real_atan2(d.x, -d.z) + rotation) / (2 * KILN_REAL_PI);
    u -= real_floor(u);
    return KILN_TO_U32(real_min(kiln_real_of(width) - 1, u * kiln_real_of(width)));
}
KILN_FUNCTION KILN_U32 kiln_sky_row(kiln_real3 d, KILN_U32 height)
{
    const kiln_real v = real_acos(real_clamp(d.y, kiln_real_of(-1), kiln_real_of(1))) / KILN_REAL_PI;
    return KILN_TO_U32(real_min(kiln_real_of(height) - 1, v * kiln_real_of(height)));
}

/* Probability of entry `index` of a cumulative table whose entry 0 is array[first]. */
KILN_FUNCTION kiln_real kiln_step_chance(KILN_FLOATS cumulative, KILN_INDEX first, KILN_U32 index)
{
    return kiln_real_of(KILN_FLOAT_OF(cumulative, first + index)) -
           (index == 0u ? kiln_real_of(0) : kiln_real_of(KILN_FLOAT_OF(cumulative, first + index - 1u)));
}

/* Finds the first entry above u in a cumulative table that begins at array[first]. `within` receives the relative
 * position of u in the entry, below 1. */
KILN_FUNCTION KILN_U32 kiln_step_find(KILN_FLOATS cumulative, KILN_INDEX first, KILN_U32 count, kiln_real u,
                                      KILN_OUT(kiln_real) within)
{
    KILN_U32 low = 0u, high = count - 1u;
    while (low < high) {
        const KILN_U32 middle = low + (high - low) / 2u;
        if (kiln_real_of(KILN_FLOAT_OF(cumulative, first + middle)) > u)
            high = middle;
        else
            low = middle + 1u;
    }
    const kiln_real begin = low == 0u ? kiln_real_of(0) : kiln_real_of(KILN_FLOAT_OF(cumulative, first + low - 1u)),
                    end = kiln_real_of(KILN_FLOAT_OF(cumulative, first + low));
#if defined(KILN_GLSL) && !defined(KILN_DOUBLES)
    const kiln_real last = KILN_REAL_BELOW_ONE;
#else
    const kiln_real last = 1 - KILN_RATIO(1, 1000000000000ul);
#endif
    KILN_AT(within) =
        end > begin ? real_min(last, real_max(kiln_real_of(0), (u - begin) / (end - begin))) : KILN_RATIO(1, 2);
    return low;
}

/* Density per steradian of a texel. `chance`: its probability; `band`: difference of the cosines at its row's edges. */
KILN_FUNCTION kiln_real kiln_sky_density(kiln_real chance, kiln_real band, KILN_U32 width)
{
    return chance / (band * 2 * KILN_REAL_PI / kiln_real_of(width));
}

/* Direction at position (fx, fy) within texel x of a row with the cosines `top` and `bottom` at its edges. */
KILN_FUNCTION kiln_real3 kiln_sky_direction(KILN_U32 x, kiln_real fx, kiln_real fy, kiln_real top, kiln_real bottom,
                                            KILN_U32 width, kiln_real rotation)
{
    const kiln_real height = top + (bottom - top) * fy, r = real_sqrt(real_max(kiln_real_of(0), 1 - height * height));
    kiln_real sine, cosine;
    real_sincos(((kiln_real_of(x) + fx) / kiln_real_of(width) - KILN_RATIO(1, 2)) * 2 * KILN_REAL_PI - rotation,
                KILN_TO(sine), KILN_TO(cosine));
    return real3_make(r * sine, height, -r * cosine);
}

/* Pi times the density of a direction sampled by a mixture: half cosine-distributed about the geometric normal, half
 * about the shading normal. The arguments are its two cosines, at least one above 0. Sampling about the geometric
 * normal alone, with weight shading cosine / geometric cosine, has unbounded variance (the integral of 1 / n.w). */
KILN_FUNCTION kiln_real kiln_sky_two_cosines(kiln_real cosine, kiln_real shading_cosine)
{
    return KILN_RATIO(1, 2) * (real_max(kiln_real_of(0), cosine) + real_max(kiln_real_of(0), shading_cosine));
}

/* Density of a direction sampled alternately by the cosine (even samples) and by the image (odd samples), for the
 * balance heuristic (Veach and Guibas, "Optimally Combining Sampling Techniques for Monte Carlo Rendering", 1995). */
KILN_FUNCTION kiln_real kiln_sky_cosine_density(KILN_U32 samples, kiln_real by_sky, kiln_real by_cosine)
{
    const kiln_real share = kiln_real_of(samples / 2u) / kiln_real_of(samples);
    return share * by_sky + (1 - share) * by_cosine;
}

#endif
