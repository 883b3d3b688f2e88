/* Whether a surface with alpha lets a ray through: a masked one where alpha is below the cutoff; a blended one with chance
 * 1 - alpha, by a hash of the ray's own direction, so that the same ray always decides alike. */
#ifndef KILN_SHADERS_TRACE_ALPHA_GLSL
#define KILN_SHADERS_TRACE_ALPHA_GLSL

#include "shaders/material.glsl"

bool kiln_lets_through(uint triangle, float u, float v, vec3 direction)
{
    const vec2 alpha_cutoff = kiln_surface_alpha(triangle, u, v);
    if (alpha_cutoff.y >= 0.0)
        return alpha_cutoff.x < alpha_cutoff.y;
    const uvec3 bits = floatBitsToUint(direction);
    const uint hash = kiln_hash2(kiln_hash2(bits.x, bits.y), kiln_hash2(bits.z, triangle));
    return float(hash >> 8) * 5.9604644775390625e-8 >= alpha_cutoff.x;
}

#endif
