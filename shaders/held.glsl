/* Light that stays on the device (shaders/shared/layout_held.h): radiosity as it is packed and rounded
 * (worker/scene/radiosity.h), with the bits of the host. Needs kernel.glsl. */
#include "shaders/radiosity.glsl"

layout(buffer_reference, scalar, buffer_reference_align = 8) readonly buffer HeldRef { kiln_gpu_held value; };
KILN_ARRAY(HeldPoints, kiln_gpu_held_point, 8);
KILN_ARRAY(HeldLights, kiln_gpu_held_light, 8);
KILN_ARRAY(HeldTerms, kiln_gpu_held_term, 8);
KILN_ARRAY(DirectAnswers, kiln_gpu_direct_answer, 4);
KILN_ARRAY(HeldPowers, kiln_gpu_held_power, 8);
KILN_ARRAY(HeldPairs, uvec2, 8);
KILN_ARRAY(HeldWords, uint, 4);
KILN_ARRAY(HeldFloats, float, 4);

uint held_channel(float value, uint random10)
{
    const uint bits = floatBitsToUint(value);
    if (!(value > 0.0))
        return 0u;
    return (bits >= 0x7f7ffc00u ? 0x7f7ffc00u : bits + (random10 & 1023u)) >> KILN_RADIOSITY_DROPPED;
}

uvec2 held_pair(uint red, uint green, uint blue) { return uvec2(red | green << 21, green >> 11 | blue << 10); }

/* kiln_radiosity_pack */
uvec2 held_pack(vec3 rgb, uint hash)
{
    return held_pair(held_channel(rgb.r, hash), held_channel(rgb.g, hash >> 10), held_channel(rgb.b, hash >> 20));
}

double held_power_of_two(int exponent) { return packDouble2x32(uvec2(0u, uint(exponent + 1023) << 20)); }

/* The 8-byte form of a 4-byte one. */
uvec2 held_expand(uint compact, int scale)
{
    const uint quantum = uint(scale + int(compact >> 26) - 41) << 23;
    const uvec3 whole = uvec3(compact & 511u, compact >> 9 & 511u, 2u * (compact >> 18 & 255u));
    uvec3 bits;
    for (int c = 0; c < 3; c++)
        bits[c] = whole[c] == 0u ? 0u : floatBitsToUint(float(whole[c])) + quantum >> KILN_RADIOSITY_DROPPED;
    return held_pair(bits.r, bits.g, bits.b);
}

/* The least exponent k with value <= most x 2^k. `most` is 511 or 510, which is 256 x (1 + below / 2^23). */
int held_exponent(float value, uint below)
{
    const uint bits = floatBitsToUint(value);
    return int(bits >> 23) - 127 - ((bits & 0x7fffffu) <= below ? 8 : 7);
}

uint held_compact_channel(float value, double per_quantum, uint most, uint random10)
{
    const double steps =
        value > 0.0 ? double(value) * per_quantum + (double(random10 & 1023u) + 0.5LF) * 0.0009765625LF : 0.0LF;
    return steps < double(most) ? uint(steps) : most;
}

/* kiln_radiosity_compact */
uint held_compact(vec3 rgb, int scale, uint hash)
{
    const float largest = max(rgb.r, max(rgb.g, rgb.b));
    int exponent = 0;
    if (isinf(largest))
        exponent = 63;
    else if (largest > 0.0)
        exponent = 41 - scale + max(held_exponent(max(rgb.r, rgb.g), 0x7f8000u), held_exponent(rgb.b, 0x7f0000u));
    exponent = clamp(exponent, 0, 63);
    const double per_quantum = held_power_of_two(41 - scale - exponent);
    return held_compact_channel(rgb.r, per_quantum, 511u, hash) |
           held_compact_channel(rgb.g, per_quantum, 511u, hash >> 10) << 9 |
           held_compact_channel(rgb.b, 0.5LF * per_quantum, 255u, hash >> 20) << 18 | uint(exponent) << 26;
}

/* Random bits: kiln_packing_hash (coordinator/integrate/packing.h). */
uint held_hash(kiln_gpu_held_point p, uint bit, uint stream) { return kiln_hash2(p.tile, stream * 64u + bit); }

/* Random bits for the 4-byte form: compact_hash (coordinator/integrate/cells/take.c). */
uint held_compact_hash(kiln_gpu_held_point p, uint stream, uint seed)
{
    const uint tile = kiln_hash2(held_hash(p, 0u, stream), seed), reversed = bitfieldReverse(p.bit) >> 22;
    return ((tile + reversed) & 1023u) | (((tile >> 10) + reversed) & 1023u) << 10 |
           (((tile >> 20) + reversed) & 1023u) << 20;
}

/* Returns the radiosity that the point sends next, in the format that gathering points read. */
uvec2 held_next(kiln_gpu_held held, kiln_gpu_held_point p, vec3 rgb, int scale)
{
    if (held.compact != 0u)
        return held_expand(held_compact(rgb, scale, held_compact_hash(p, held.stream, held.seed)), scale);
    return held_pack(rgb, held_hash(p, p.bit, held.stream));
}

/* kiln_error_pack, of an error that is no NaN; and kiln_error_unpack */
uint held_error_pack(float error)
{
    const uint bits = floatBitsToUint(error), rounded = (bits + 0x7fffu + (bits >> 16 & 1u)) >> 16;
    return bits >= 0x7f800000u ? bits >> 16 : min(rounded, 0x7f7fu);
}
uint held_error_add(uint packed, float error)
{
    const double before = double(uintBitsToFloat(packed << 16)), more = double(error);
    return held_error_pack(float(sqrt(before * before + more * more)));
}

/* kiln_point_albedo */
vec3 held_albedo(uint64_t albedo, uint64_t own)
{
    precise vec3 rgb;
    for (uint c = 0u; c < 3u; c++) {
        const uint64_t half_ = 3ul * own + uint64_t(c);
        const uint two = HeldWords(albedo + (half_ >> 1) * 4ul).at[0];
        rgb[c] = float((half_ & 1ul) != 0ul ? two >> 16 : two & 0xffffu) * KILN_RATIO32(1, 65535);
    }
    return rgb;
}
