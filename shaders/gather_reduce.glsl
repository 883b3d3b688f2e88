/* Adds up what gather.glsl found and makes each point's answer of it; zeros for invalid points. Needs kernel.glsl
 * before it, and KILN_GLOSS where gather.glsl had it. Who includes this may define GATHER_ANSWER(x, r), what becomes of
 * the answer r of point x; or GATHER_KERNEL, and ask gather_result in a kernel of its own. */
const uint TINTED_FLOATS = HAS_ALPHA >= KILN_PASSAGE_TINT ? KILN_GPU_SLICE_TINTED_FLOATS : KILN_GPU_SLICE_FLOATS;
#ifdef KILN_GLOSS
const uint FLOATS = TINTED_FLOATS + KILN_GPU_SLICE_GLOSS;
const uint MOST_FLOATS = KILN_GPU_SLICE_TINTED_FLOATS + KILN_GPU_SLICE_GLOSS, MEASURED = 8u;
#else
const uint FLOATS = TINTED_FLOATS;
const uint MOST_FLOATS = KILN_GPU_SLICE_TINTED_FLOATS, MEASURED = 8u;
#endif
#include "shaders/hemisphere_reduce.glsl"

#if !defined(GATHER_ANSWER) && !defined(GATHER_KERNEL)
#    include "shaders/short_answer.glsl"
#    define GATHER_ANSWER(x, r) put_answer(push.results, x, r, true, push.samples)
#endif

/* The harmonics of radiance probes may be negative; a point's light is not. */
float at_least_zero(float sum) { return sum < 0.0 ? 0.0 : sum; }

/* The answer of point x of the chunk; false: it is not valid. */
bool gather_result(uint x, out kiln_gpu_result r)
{
    r = kiln_gpu_result(float[3](0.0, 0.0, 0.0), float[3](0.0, 0.0, 0.0), 0.0, 0.0, 0.0, float[3](0.0, 0.0, 0.0),
                        float[3](0.0, 0.0, 0.0), 0.0, 0u);
    Totals totals;
    if (!hemisphere_totals(x, totals))
        return false;
    const float n = float(push.samples);
    for (uint c = 0u; c < 3u; c++) {
        r.incident[c] = at_least_zero(totals.sum[c]);
        r.irradiance[c] = at_least_zero(totals.sum[3u + c]);
        if (HAS_ALPHA >= KILN_PASSAGE_TINT)
            r.glass[c] = totals.sum[9u + c];
#ifdef KILN_GLOSS
        r.gloss[c] = totals.sum[TINTED_FLOATS + c];
#endif
    }
    r.escaped = totals.sum[6];
    r.blocked = totals.sum[7];
    r.count = push.samples;
    for (uint q = 0u; q < 4u; q++)
        totals.quarters[q] /= 0.25 * n;
    if (push.samples >= 4u)
        r.error = n * quarters_error(totals.quarters);
    if (r.escaped < 0.0)
        r.error = -1.0; /* the answer is not good */
    r.present = PointArray(push.chunk.points).at[push.chunk.origin + x].present;
    return true;
}

#ifndef GATHER_KERNEL
void kiln_kernel(uint x, uint y)
{
    if (x >= push.chunk.total)
        return;
    kiln_gpu_result r;
    gather_result(x, r);
    GATHER_ANSWER(x, r);
}

#    include "shaders/main.glsl"
#endif
