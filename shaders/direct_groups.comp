/* The direct pass for bakes with groups of lights. Before the shadow rays (CLEARS), thread (x, y) clears float y in row
 * x of all points' rows. Afterwards, thread (x, y) makes the answer of point x for group y, from its rows in their
 * order. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"
#include "shaders/direct.glsl"
#include "shaders/light_groups.glsl"

layout(constant_id = 6) const uint CLEARS = 0u;

void kiln_kernel(uint x, uint y)
{
    if (CLEARS != 0u) {
        if (x < direct_rows())
            direct_groups(y).at[x] = 0.0;
        return;
    }
    if (x >= push.chunk.total)
        return;
    const uint word = DirectWords(push.chunk.states).at[push.chunk.origin + x], state = word & KILN_GPU_STATE_MASK;
    const uint count = GroupsRef(SCENE.lights.groups).value.count;
    uint slices, split;
    direct_slices(word, false, slices, split);
    const uint rows = state == KILN_GPU_STATE_INVALID ? 0u : 4u * slices * split,
               step = state == KILN_GPU_STATE_BURIED ? 1u : split;
    for (uint c = 0u; c < GROUP_FLOATS; c++) {
        real sum = 0;
        for (uint row = 0u; row < rows; row += step)
            sum += real(DirectFloats(uint64_t(direct_groups(y * GROUP_FLOATS + c)) + 4ul * direct_row(x, row)).at[0]);
        DirectFloats(push.pass.results + uint64_t(x) * uint64_t(4u * GROUP_FLOATS * count)).at[y * GROUP_FLOATS + c] =
            float(real(direct_samples(word)) * sum);
    }
}

#include "shaders/main.glsl"
