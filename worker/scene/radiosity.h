/* Radiosity as it is kept and exchanged: 8 bytes a point, three unsigned floats of 21 bits (8 exponent, 13 mantissa).
 *
 * Rounding is stochastic, driven by a hash the caller gives, so that the mean over many points is exact and a furnace with
 * albedo 0.99 does not drift; a value is off by at most 2^-13 of itself. Negative values and NaN become 0; values above
 * 3.4e38 become the largest finite one. One aligned load fetches all three channels. */
#ifndef KILN_WORKER_SCENE_RADIOSITY_H
#define KILN_WORKER_SCENE_RADIOSITY_H

#include <stdint.h>
#include <string.h>

static inline uint64_t kiln_radiosity_pack_channel(float value, uint32_t random10)
{
    if (!(value > 0.0f))
        return 0;
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    if (bits >= 0x7f7ffc00u) /* infinite, or would round up to it */
        return 0x7f7ffc00u >> 10;
    return (bits + (random10 & 1023u)) >> 10;
}

/* `hash` supplies 30 random bits; a function of the point and bounce, so that every rank packs alike. */
static inline uint64_t kiln_radiosity_pack(const float rgb[3], uint32_t hash)
{
    return kiln_radiosity_pack_channel(rgb[0], hash) | kiln_radiosity_pack_channel(rgb[1], hash >> 10) << 21 |
           kiln_radiosity_pack_channel(rgb[2], hash >> 20) << 42;
}

static inline void kiln_radiosity_unpack(uint64_t packed, float rgb[3])
{
    for (int c = 0; c < 3; c++) {
        const uint32_t bits = (uint32_t)(packed >> (21 * c) & 0x1fffffu) << 10;
        memcpy(&rgb[c], &bits, sizeof bits);
    }
}

#endif
