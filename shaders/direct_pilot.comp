/* The direct pass, between choose.comp and direct.comp: traces pilots for directional lights, and adapts the numbers of
 * samples to their results (shaders/shared/sun_pilot.h). Thread x: point x of the chunk; partly buried points have no
 * pilots. For scenes with an environment and directional lights. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"
#include "shaders/direct.glsl"

#define KILN_TRACES
#include "shaders/trace/trace.glsl"
#include "shaders/surface.glsl"
#include "shaders/position.glsl"
#include "shaders/direct_sequence.glsl"
#include "shaders/shared/sun_pilot.h"

/* Returns the share of the light that arrives along the pilot's ray k. */
float share_of(kiln_gpu_point p, vec3 towards, Sequence sequence, uint k, bool beyond, inout uint rays)
{
    vec3 position, n;
    float offset;
    kiln_position(p, push.chunk.parts, float(real_unit(draw(sequence, k, KILN_DIMENSION_S))),
                  float(real_unit(draw(sequence, k, KILN_DIMENSION_T))), position, n, offset);
    if (beyond) /* start the ray by the same distance farther off the surface */
        position += (position - p.centre) * KILN_SUN_PILOT_BEYOND;
    const float shading = dot(kiln_shading(p, n), towards);
    const float share = kiln_faces(p, dot(n, towards), shading) ? max(0.0, shading) : 0.0;
    if (!(share > 0.0))
        return 0.0;
    rays++;
    return share * float(real_luminance(real3(kiln_through(position, towards, KILN_INFINITY))));
}

/* Whether the light varies over and around the point. */
bool pilot_differs(kiln_gpu_point p, uint light, uint count, inout uint rays)
{
    const vec3 towards = vec3(real3_of(DirectionalLights(SCENE.lights.directionals).at[light].towards));
    const uint identity = kiln_direct_identity(KILN_CHOICE_DIRECTIONAL, light, push.pass.stream);
    const Sequence sequence = sequence_of(p, identity + 1u);
    float least = KILN_INFINITY, most = 0.0;
    for (uint k = 0u; k < count; k++) {
        const float share = share_of(p, towards, sequence, k, k >= count / 2u, rays);
        least = min(least, share);
        most = max(most, share);
    }
    return least < KILN_SUN_SAME * most;
}

bool is_sun(kiln_gpu_choice choice) { return choice.what >> KILN_GPU_CHOICE_KIND_SHIFT == KILN_CHOICE_DIRECTIONAL; }

/* Distributes `rest` samples among the choices that are not directional lights, which have `others` samples now. */
void share_out(uint x, uint count, uint others, uint rest)
{
    for (uint i = 0u; i < count; i++) {
        const kiln_gpu_choice c = direct_choice(i).at[x];
        if (is_sun(c))
            continue;
        const uint samples = kiln_sun_other(c.samples & ~KILN_GPU_CHOICE_PRECISE, others, rest);
        direct_choice(i).at[x].samples = samples | (c.samples & KILN_GPU_CHOICE_PRECISE);
    }
}

void kiln_kernel(uint x, uint y)
{
    const uint index = push.chunk.origin + x;
    const uint word = x < push.chunk.total ? DirectWords(push.chunk.states).at[index] : KILN_GPU_STATE_INVALID,
               state = word & KILN_GPU_STATE_MASK;
    if (state == KILN_GPU_STATE_INVALID)
        return;
    const uint samples = direct_samples(word), pilot = kiln_sun_pilot(samples),
               count = state == KILN_GPU_STATE_BURIED ? 0u : direct_counts().at[x] & ~KILN_GPU_COUNT_PRECISE;
    kiln_sun_sharing sharing = kiln_sun_sharing(samples, samples, 0u, false);
    uint rays = 0u;
    for (uint i = 0u; i < count; i++) {
        const kiln_gpu_choice c = direct_choice(i).at[x];
        if (!kiln_sun_asks(sharing, is_sun(c), c.samples & ~KILN_GPU_CHOICE_PRECISE))
            continue;
        const bool differs = pilot_differs(PointArray(push.chunk.points).at[index],
                                           c.what & ((1u << KILN_GPU_CHOICE_KIND_SHIFT) - 1u), pilot, rays);
        direct_choice(i).at[x].samples = kiln_sun_samples(sharing, c.samples, differs);
    }
    if (sharing.any)
        share_out(x, count, sharing.others, sharing.rest);
    direct_pilot_rays().at[x] = rays;
}

#include "shaders/main.glsl"
