/* The direct pass, step 1: chooses the lights that each point samples, and their numbers of samples. Thread x: point x
 * of the chunk. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"
#include "shaders/direct.glsl"
#include "shaders/area_light_sampler.glsl"

KILN_ARRAY(PointArray, kiln_gpu_point, 8);

void kiln_kernel(uint x, uint y)
{
    const uint index = push.chunk.origin + x;
    const uint word = x < push.chunk.total ? DirectWords(push.chunk.states).at[index] : KILN_GPU_STATE_INVALID,
               state = word & KILN_GPU_STATE_MASK;
    if (state == KILN_GPU_STATE_INVALID)
        return;
    const kiln_gpu_point p = PointArray(push.chunk.points).at[index];
    const real3 normal = (p.flags & KILN_GPU_POINT_ONE_NORMAL) != 0u ? real3(p.normal) : real3(0);
    const uint candidates = kiln_lights_choose(real3(p.centre), real(p.spread), normal, direct_limit(word), true);
    uint count = 0u, precise_ones = 0u;
    for (uint i = 0u; i < candidates; i++) {
        kiln_light_choice choice;
        if (!kiln_lights_candidate(i, normal, direct_samples(word), choice))
            continue;
        const bool is_target = kiln_light_is_target(choice, p.centre, p.spread);
        const uint kind = is_target ? KILN_GPU_CHOICE_TARGET : choice.kind;
        uint samples = choice.samples;
#ifdef KILN_FLOAT64
        if (!is_target && state == KILN_GPU_STATE_VALID &&
            kiln_is_lone_area_light(choice)) { /* very near, or seen from its edge */
            samples |= KILN_GPU_CHOICE_PRECISE;
            precise_ones = KILN_GPU_COUNT_PRECISE;
        }
#endif
        direct_choice(count).at[x] = kiln_gpu_choice(kind << KILN_GPU_CHOICE_KIND_SHIFT | choice.index, samples);
        count++;
    }
    direct_counts().at[x] = count | precise_ones;
}

#include "shaders/main.glsl"
