/* Sums over the slices of a point (hemisphere_reduce.glsl). Before it stands MOST_FLOATS, a literal: how many floats a
 * slice may have. */
#include "shaders/sum.glsl"

struct Totals {
    float sum[MOST_FLOATS];
    float quarters[4]; /* what the four quarters of the samples have of one of them */
};

float float_of(kiln_sum sum) { return sum.high + sum.low; }

/* Standard error of the mean of four sub-nets, from their means: more than the error of the whole net, whose parts
 * balance one another. Squares are of differences over a power of two near the largest, so that they fit a float. */
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
