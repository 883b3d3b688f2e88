/* Sums over the slices of a point (hemisphere_reduce.glsl). Before it stands MOST_FLOATS, a literal: the largest number
 * of floats of a slice. */
#include "shaders/sum.glsl"

struct Totals {
    float sum[MOST_FLOATS];
    float quarters[4]; /* sums of one of the floats over the four quarters of the samples */
};

float float_of(kiln_sum sum) { return sum.high + sum.low; }

/* Standard error of the mean, from the means of four sub-nets. It is larger than the error of the whole net, whose
 * parts compensate one another. Differences are divided by a power of two near the largest, so that squares fit a
 * float. */
float quarters_error(float quarters[4])
{
    const float middle = 0.25 * (quarters[0] + quarters[1] + quarters[2] + quarters[3]);
    float most = 0.0, square = 0.0;
    for (uint q = 0u; q < 4u; q++)
        most = max(most, abs(quarters[q] - middle));
    int exponent;
    frexp(most, exponent);
    exponent = clamp(exponent, -126, 126);
    const float down = ldexp(1.0, -exponent);
    for (uint q = 0u; q < 4u; q++) {
        const float off = down * (quarters[q] - middle);
        square += off * off;
    }
    return ldexp(1.0, exponent) * sqrt(square / 12.0);
}
