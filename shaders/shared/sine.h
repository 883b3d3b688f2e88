/* Taylor series of sine and cosine in doubles, for angles within a quarter turn about 0. Vectorised C, and GLSL, which
 * has no sine of doubles, reduce any angle to this range. Errors are below 1e-15. */
#ifndef KILN_SHADERS_SHARED_SINE_H
#define KILN_SHADERS_SHARED_SINE_H

#include "shaders/shared/real.h"

/* 1 / n! for n from 12 on; `rest` is n! / 12!, since n! itself exceeds 2^32. */
#define KILN_ONE_OVER_12_TIMES(rest) (1 / (kiln_real_of(479001600) * (rest)))

/* `r2` is the square of r. */
KILN_FUNCTION kiln_real kiln_sine_series(kiln_real r, kiln_real r2)
{
    return r + r * r2 *
                   (KILN_RATIO(-1, 6) +
                    r2 * (KILN_RATIO(1, 120) + r2 * (KILN_RATIO(-1, 5040) +
                                                     r2 * (KILN_RATIO(1, 362880) +
                                                           r2 * (KILN_RATIO(-1, 39916800) +
                                                                 r2 * (KILN_ONE_OVER_12_TIMES(13) +
                                                                       r2 * (-KILN_ONE_OVER_12_TIMES(2730) +
                                                                             r2 * KILN_ONE_OVER_12_TIMES(742560))))))));
}
KILN_FUNCTION kiln_real kiln_cosine_series(kiln_real r2)
{
    return 1 + r2 * (KILN_RATIO(-1, 2) +
                     r2 * (KILN_RATIO(1, 24) + r2 * (KILN_RATIO(-1, 720) +
                                                     r2 * (KILN_RATIO(1, 40320) +
                                                           r2 * (KILN_RATIO(-1, 3628800) +
                                                                 r2 * (KILN_RATIO(1, 479001600) +
                                                                       r2 * (-KILN_ONE_OVER_12_TIMES(182) +
                                                                             r2 * KILN_ONE_OVER_12_TIMES(43680))))))));
}

#endif
