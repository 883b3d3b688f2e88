/* The direct pass, last step: sums up each point's rows to its answer, in a fixed order; zeros for invalid points. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"
#include "shaders/direct.glsl"

KILN_ARRAY(PointArray, kiln_gpu_point, 8);
#include "shaders/short_answer.glsl"

/* Rows of a quarter of a point; each `step`-th row is used. */
struct Rows {
    uint count, step;
};

/* Luminance of the samples of choice i in quarter q. */
real quarter_of(uint i, uint q, Rows rows, uint x)
{
    real sum = 0;
    for (uint s = 0u; s < rows.count; s += rows.step)
        sum += real(direct_luminance(i, x, q * rows.count + s).at[0]);
    return sum;
}

/* Variance of the mean luminance of choice i, estimated from its four quarters (shadow_variance). */
real quarters_variance(uint i, Rows rows, uint x, uint samples)
{
    real quarter[4], total = 0, spread = 0;
    for (uint q = 0u; q < 4u; q++) {
        quarter[q] = quarter_of(i, q, rows, x);
        total += quarter[q];
    }
    const real mean = total / real(samples);
    for (uint q = 0u; q < 4u; q++) { /* if 4 does not divide their number, quarters differ by one sample */
        const uint begin = kiln_quarter_first(q, samples), end = kiln_quarter_first(q + 1u, samples);
        const real off = quarter[q] / real(end - begin) - mean;
        spread += off * off;
    }
    return spread / 12;
}

void kiln_kernel(uint x, uint y)
{
    if (x >= push.chunk.total)
        return;
    const uint index = push.chunk.origin + x;
    uint rays = 0u;
    kiln_gpu_result r = kiln_gpu_result(float[3](0.0, 0.0, 0.0), float[3](0.0, 0.0, 0.0), 0.0, 0.0, 0.0,
                                        float[3](0.0, 0.0, 0.0), float[3](0.0, 0.0, 0.0), 0.0, 0u);
    const uint word = DirectWords(push.chunk.states).at[index], state = word & KILN_GPU_STATE_MASK;
    if (state != KILN_GPU_STATE_INVALID) {
        real3 incident = real3(0), irradiance = real3(0);
        real variance = 0;
        uint stopped = 0u;
        uint slices, split;
        direct_slices(word, false, slices, split);
        const Rows rows = Rows(slices * split, state == KILN_GPU_STATE_BURIED ? 1u : split);
        if (direct_has_pilots())
            rays = direct_pilot_rays().at[x];
        for (uint row = 0u; row < 4u * rows.count; row += rows.step) {
            const kiln_gpu_direct_sums sums = direct_sums(x, row).at[0];
            stopped |= sums.stopped;
            incident += real3_of(sums.incident);
            irradiance += real3_of(sums.irradiance);
            variance += sums.variance;
            rays += sums.rays;
        }
        const uint count = direct_counts().at[x] & ~KILN_GPU_COUNT_PRECISE;
        for (uint i = 0u; i < count; i++) {
            const uint samples = direct_choice(i).at[x].samples & ~KILN_GPU_CHOICE_PRECISE;
            if (samples >= KILN_QUARTERS_FROM)
                variance += quarters_variance(i, rows, x, samples);
        }
        const real n = real(direct_samples(word)); /* of the point, whatever number a light has of them */
        for (uint c = 0u; c < 3u; c++) {
            r.incident[c] = float(n * incident[c]);
            r.irradiance[c] = float(n * irradiance[c]);
        }
        r.error = stopped != 0u ? -1.0 : float(n * sqrt(variance)); /* -1: the answer is not good */
        r.count = direct_samples(word);
        r.present = PointArray(push.chunk.points).at[index].present;
    }
    put_answer(push.pass.results, x, r, false, push.pass.samples);
    DirectWords(push.pass.rays).at[x] = rays;
}

#include "shaders/main.glsl"
