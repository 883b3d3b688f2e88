/* Payload exchanged between the shaders of the ray-tracing pipeline, 16 bytes; floats as their bits.
 *
 * The flags of a ray tell the any-hit shader how to treat surfaces that let light through (shaders/trace/alpha.glsl).
 * Until the result replaces it, the payload contains:
 *
 * No flags: search for the nearest surface. `v` is KILN_SOLID or KILN_BY_CHANCE, `u` the seed; `distance` becomes 1 if
 * a coloured surface was passed, which the closest-hit shader reports.
 *
 * Skip closest hit: tint. `triangle_back` is the seed; u, v, distance are the optical depths of red, green and blue.
 *
 * Skip closest hit, end on first hit: light let through. The same, without a seed.
 *
 * Any-hit shaders are called in any order. So products of transmittances are computed as sums of optical depths, -log2,
 * in units of 2^-24. */
#define KILN_PAYLOAD_BACK 0x80000000u /* with the triangle's number; KILN_GPU_NONE alone: nothing was met */
#define KILN_PAYLOAD_TINTED 0x40000000u
#define KILN_PAYLOAD_NUMBER 0x3fffffffu

struct kiln_payload {
    uint triangle_back;
    uint u, v, distance;
};

const uint KILN_DEEPEST = uint(KILN_DEPTH_MOST) << 24; /* 2^-48 and less is nothing */

void kiln_deepen(inout kiln_payload payload, vec3 through)
{
    const uvec3 deeper = uvec3(min(-log2(clamp(through, 1.0e-30, 1.0)), float(KILN_DEPTH_MOST)) * 16777216.0 + 0.5);
    const uvec3 depth = min(uvec3(payload.u, payload.v, payload.distance) + deeper, uvec3(KILN_DEEPEST));
    payload.u = depth.x;
    payload.v = depth.y;
    payload.distance = depth.z;
}

vec3 kiln_share_of(kiln_payload payload)
{
    const uvec3 depth = uvec3(payload.u, payload.v, payload.distance);
    return mix(exp2(-vec3(depth) / 16777216.0), vec3(0.0), greaterThanEqual(depth, uvec3(KILN_DEEPEST)));
}
