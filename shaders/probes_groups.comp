/* Light of groups at probes: thread (x, y) sums up the light of group y among the results of probe x's rays
 * (probes.comp). */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"
#include "shaders/shared/harmonics.h"
#include "shaders/shared/layout_probe.h"
#include "shaders/radiosity.glsl"

KILN_PUSH(kiln_gpu_probe_groups_push);

KILN_ARRAY(FloatArray, float, 4);
KILN_ARRAY(RadiosityWords, uvec2, 8);

struct Sums {
    vec3 radiance[KILN_HARMONICS], axes[6];
};

#include "shaders/probe_direction.glsl"
#include "shaders/probe_found.glsl"

/* Returns the group's part of the radiance that a ray over the sphere found. */
vec3 radiance_of(uint word, uint group)
{
    if (word < FOUND_SKY) {
        const uint64_t pair = uint64_t(word) * push.groups + group;
        return KILN_INVERSE_PI * kiln_radiosity_unpack(RadiosityWords(push.radiosity + 8ul * pair).at[0]);
    }
    return word == (FOUND_SKY | group) ? vec3(SCENE.lights.sky[0], SCENE.lights.sky[1], SCENE.lights.sky[2])
                                       : vec3(0.0);
}

void kiln_kernel(uint x, uint y)
{
    if (x >= push.count || y >= push.groups)
        return;
    Sums sums;
    for (uint i = 0u; i < KILN_HARMONICS; i++)
        sums.radiance[i] = vec3(0.0);
    for (uint i = 0u; i < 6u; i++)
        sums.axes[i] = vec3(0.0);
    uint k = 0u;
    for (; k < push.samples; k++) {
        const Found found = found_sphere(k, x).at[0];
        const vec3 radiance = radiance_of(found.word, y);
        if (radiance != vec3(0.0))
            add_direction(sums, found.direction, radiance * (12.566370614359172 / float(push.samples)));
    }
    bool stopped = k < push.samples;
    const uint lights = min(found_lights(x).at[0], push.lights);
    for (k = 0u; k < lights; k++) {
        const FoundLight found = found_light(k, x).at[0];
        if (found.group == y)
            add_direction(sums, found.direction, found.value);
    }
    stopped = stopped || k < lights;
    FloatArray floats =
        FloatArray(push.results + uint64_t(4u * KILN_GPU_PROBE_GROUP_FLOATS) * (uint64_t(x) * push.groups + y));
    for (uint c = 0u; c < 3u; c++) {
        for (uint i = 0u; i < KILN_HARMONICS; i++)
            floats.at[3u * i + c] = sums.radiance[i][c];
        for (uint i = 0u; i < 6u; i++)
            floats.at[27u + 3u * i + c] = sums.axes[i][c];
    }
    if (stopped)
        floats.at[0] = -1.0e30;
}

#include "shaders/main.glsl"
