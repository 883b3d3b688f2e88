/* Adds up what gather.glsl found and makes each point's answer of it; zeros for invalid points. Needs kernel.glsl
 * before it, and KILN_GLOSS where gather.glsl had it. Who includes this may define GATHER_ANSWER(x, r), what becomes of
 * the answer r of point x. */
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
