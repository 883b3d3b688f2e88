/* Counts how many of some positions of each point are buried, one thread per point. See the validity pass of the Embree
 * backend: 16 positions first, 64 more if they differ. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"

KILN_PUSH(kiln_gpu_validity_push);

#define KILN_VALIDITY
#define KILN_TRACES
#include "shaders/trace/trace.glsl"
#include "shaders/surface.glsl"
#include "shaders/position.glsl"

void kiln_kernel(uint x, uint y)
{
    if (x >= push.chunk.count)
        return;
    const uint index =
        push.chunk.list != 0ul ? WordArray(push.chunk.list).at[push.chunk.first + x] : push.chunk.first + x;
    const uint key = kiln_validity_key(push.stream);
    kiln_gpu_point p = PointArray(push.chunk.points).at[index];
    p.key = key;
    const uint shift_s = kiln_hash1(key), shift_t = kiln_hash1(key + 1u);
    WordArray sobol = WordArray(push.sobol);
    uint buried = 0u;
    for (uint k = 0u; k < push.looks; k++) {
        vec3 position, normal;
        float offset;
        kiln_place(p, push.chunk.parts, kiln_unit_float(sobol.at[k] ^ shift_s),
                   kiln_unit_float(sobol.at[push.sobol_stride + k] ^ shift_t), position, normal, offset);
        buried += kiln_buried(position, normal) ? 1u : 0u;
    }
    WordArray(push.counts).at[x] = buried;
}

#include "shaders/main.glsl"
