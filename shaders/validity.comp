/* Which places of each point are buried: thread (x, y) looks at place y of point x and adds 1 to the point's count when it is. See
 * the validity pass of the Embree backend: 16 places first, 64 more where they disagree. */
#version 460
#extension GL_GOOGLE_include_directive : require
#include "shaders/kernel.glsl"

layout(push_constant, scalar) uniform Push
{
    KILN_ADDRESS scene;
    kiln_gpu_chunk chunk; /* `list`: the points of the second look */
    KILN_ADDRESS sobol;
    KILN_ADDRESS counts; /* word of thread x */
    KILN_WORD stream, sobol_stride;
} push;

#define KILN_TRACES
#include "shaders/trace.glsl"
#include "shaders/surface.glsl"
#include "shaders/position.glsl"

void kiln_kernel(uint x, uint y)
{
    if (x >= push.chunk.count)
        return;
    const uint index = push.chunk.list != 0ul ? WordArray(push.chunk.list).at[push.chunk.first + x] : push.chunk.first + x;
    const kiln_gpu_point p = PointArray(push.chunk.points).at[index];
    const uint key = kiln_hash2(p.key, push.stream);
    const float s = kiln_unit_float(WordArray(push.sobol).at[y] ^ kiln_hash1(key));
    const float t = kiln_unit_float(WordArray(push.sobol).at[push.sobol_stride + y] ^ kiln_hash1(key + 1u));
    vec3 position, normal;
    float offset;
    kiln_place(p, push.chunk.parts, s, t, position, normal, offset);
    if (kiln_buried(position, normal))
        atomicAdd(WordArray(push.counts).at[x], 1u);
}

#include "shaders/main.glsl"
