/* Before a step: thread (x, y) clears the known visibility of group x of tile run y, either all of it or that of
 * columns that have changed. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"

KILN_PUSH(kiln_gpu_sight_forget_push);

#include "shaders/sight.glsl"

void kiln_kernel(uint x, uint y)
{
    const uint groups = SightRef(push.sight).value.groups;
    if (x >= groups || y >= push.runs)
        return;
    SightRuns runs = SightRuns(SightRef(push.sight).value.runs);
    if (runs.at[y].words == 0ul)
        return;
    Words words = Words(runs.at[y].words), same = Words(push.same);
    const bool all = Words(push.forget).at[y] != 0u;
    for (uint i = 2u * x; i < 2u * x + 2u; i++)
        words.at[i] = all ? 0u : words.at[i] & same.at[i];
    if (all)
        words.at[kiln_bits_at(groups) + x] = KILN_GPU_PAIRS_NOTHING;
    if (all && x == 0u)
        runs.at[y].used = 0u;
}

#include "shaders/main.glsl"
