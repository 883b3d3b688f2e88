/* Adds the sums of power of replay_take.comp's workgroups to the total sums: one workgroup for each sum of light y. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"

KILN_PUSH(kiln_gpu_held_push);

#include "shaders/held.glsl"

const uint THREADS = 64u;
shared int64_t high[THREADS], low[THREADS];

void kiln_kernel(uint x, uint y)
{
    const kiln_gpu_held held = HeldRef(push.held).value;
    const uint lane = gl_LocalInvocationID.x, power = x / THREADS;
    const bool there = power < KILN_GPU_HELD_POWERS && y < held.count;
    high[lane] = low[lane] = int64_t(0);
    for (uint g = lane; there && g < push.groups; g += THREADS) {
        const uint64_t at = uint64_t(g * held.count + y) * uint64_t(KILN_GPU_HELD_POWERS) + uint64_t(power);
        const kiln_gpu_held_power part = HeldPowers(held.parts + at * 16ul).at[0];
        high[lane] += int64_t(part.high);
        low[lane] += int64_t(part.low);
    }
    for (uint step = THREADS / 2u; step > 0u; step /= 2u) {
        barrier();
        if (lane < step) {
            high[lane] += high[lane + step];
            low[lane] += low[lane + step];
        }
    }
    if (lane != 0u || !there)
        return;
    HeldPowers all = HeldPowers(held.powers + uint64_t(y * KILN_GPU_HELD_POWERS + power) * 16ul);
    const int64_t sum = int64_t(all.at[0].low) + low[0];
    all.at[0].high = uint64_t(int64_t(all.at[0].high) + high[0] + (sum >> 40));
    all.at[0].low = uint64_t(sum & 0xfffffffffful);
}

#include "shaders/main.glsl"
