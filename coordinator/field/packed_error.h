/* The standard error of a surface point in 16 bits: the upper half of the float, so 8 bits of precision, 0.2 % at most.
 * An error estimated from a few groups of samples is less accurate than that, and two bytes a point are saved. */
#ifndef KILN_COORDINATOR_FIELD_PACKED_ERROR_H
#define KILN_COORDINATOR_FIELD_PACKED_ERROR_H

#include <stdint.h>
#include <string.h>

/* Rounds to nearest, ties to even. Finite values stay finite; infinity and NaN stay what they are. */
static inline uint16_t kiln_error_pack(float error)
{
    uint32_t bits;
    memcpy(&bits, &error, sizeof bits);
    const uint32_t magnitude = bits & 0x7fffffffu, sign = bits >> 16 & 0x8000u;
    if (magnitude >= 0x7f800000u)
        /* the mantissa bits that mark a NaN may lie in the lower half */
        return (uint16_t)(bits >> 16 | (magnitude > 0x7f800000u ? 0x40u : 0u));
    const uint32_t rounded = (magnitude + 0x7fffu + (magnitude >> 16 & 1u)) >> 16;
    return (uint16_t)(sign | (rounded < 0x7f80u ? rounded : 0x7f7fu));
}

static inline float kiln_error_unpack(uint16_t packed)
{
    const uint32_t bits = (uint32_t)packed << 16;
    float error;
    memcpy(&error, &bits, sizeof error);
    return error;
}

#endif
