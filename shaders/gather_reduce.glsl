/* Sums up the slices of gather.glsl to each point's answer; zeros for invalid points. Needs kernel.glsl before it, and
 * KILN_GLOSS if gather.glsl had it. The including file may define GATHER_ANSWER(x, r), which uses the answer r of point
 * x. */
const uint TINTED_FLOATS = HAS_ALPHA >= KILN_PASSAGE_TINT ? KILN_GPU_SLICE_TINTED_FLOATS : KILN_GPU_SLICE_FLOATS;
#ifdef KILN_GLOSS
const uint FLOATS = TINTED_FLOATS + KILN_GPU_SLICE_GLOSS;
const uint MOST_FLOATS = KILN_GPU_SLICE_TINTED_FLOATS + KILN_GPU_SLICE_GLOSS, MEASURED = 8u;
#else
const uint FLOATS = TINTED_FLOATS;
const uint MOST_FLOATS = KILN_GPU_SLICE_TINTED_FLOATS, MEASURED = 8u;
#endif
#include "shaders/hemisphere_reduce.glsl"

#include "shaders/gather_answer.glsl"

#ifndef GATHER_ANSWER
#    include "shaders/short_answer.glsl"
#    define GATHER_ANSWER(x, r) put_answer(push.results, x, r, true, push.samples)
#endif

void kiln_kernel(uint x, uint y)
{
    if (x >= push.chunk.total)
        return;
    Totals totals;
    kiln_gpu_result r = no_answer();
    if (hemisphere_totals(x, totals))
        r = gather_answer(totals, push.samples, PointArray(push.chunk.points).at[push.chunk.origin + x].present);
    GATHER_ANSWER(x, r);
}

#include "shaders/main.glsl"
