/* Adds the light of paths that moved between kernels to their pixels, path after path (path.glsl). Or, before they
 * begin, resets the number of paths that each kernel is to follow. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"

KILN_PUSH(kiln_gpu_path_push);
#include "shaders/path_states.glsl"
#include "shaders/path_sums.glsl"

layout(constant_id = 6) const uint CLEARS = 0u; /* so many words from push.turn on */

void kiln_kernel(uint x, uint y)
{
    if (y == 0u && x < CLEARS)
        TurnWords(push.turn).at[x] = 0u;
    if (y > 0u || CLEARS > 0u || x >= push.count)
        return;
    PathSums all = PathSums(push.sums + uint64_t(x) * 40ul);
    kiln_gpu_path_sums sums = all.at[0];
    uint rays = 0u;
    bool good = true;
    for (uint k = 0u; k < push.samples; k++) {
        const kiln_gpu_path_state s = PATH_STATE(k * push.count + x);
        path_add(sums, vec3(s.radiance[0], s.radiance[1], s.radiance[2]));
        rays += s.rays;
        good = good && s.good != 0u;
    }
    path_end(sums, good, rays);
    all.at[0] = sums;
}

#include "shaders/main.glsl"
