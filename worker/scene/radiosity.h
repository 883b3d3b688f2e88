/* Radiosity formats: how radiosity is stored and exchanged. The stored form has 8 bytes a point: three unsigned floats
 * of 21 bits (8 exponent, 13 mantissa). One aligned load fetches all three channels.
 *
 * Rounding is stochastic, driven by a hash that the caller gives. So the mean over many points is exact, and a furnace
 * with albedo 0.99 does not drift. The relative error of a value is at most 2^-13. Negative values and NaN become 0;
 * values above 3.4e38 become the largest finite one.
 *
 * Between bounces radiosity travels in 4 bytes: a shared exponent of 6 bits, 9 bits for red and green, 8 for blue
 * (which contributes least to luminance), after Ward's RGBE ("Real Pixels", Graphics Gems II, 1991) and the RGB9_E5
 * format of GPUs. Rounding is stochastic too. The scale is about the scene's mean irradiance. So values up to 2^31
 * times the mean fit, and values down to 2^-32 times the mean keep full precision, whatever the units. Even a texel
 * that receives all light of the scene is below the upper limit, since a scene has fewer than 2^31 texels. The 8-byte
 * form holds every value of the 4-byte form exactly, and packing such a value again gives the same value. */
#ifndef KILN_WORKER_SCENE_RADIOSITY_H
#define KILN_WORKER_SCENE_RADIOSITY_H

#include <math.h>
#include <stdint.h>
#include <string.h>

#include "shaders/shared/radiosity.h"

static inline uint64_t kiln_radiosity_pack_channel(float value, uint32_t random10)
{
    if (!(value > 0.0f))
        return 0;
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    if (bits >= 0x7f7ffc00u) /* infinite, or would round up to infinity */
        return 0x7f7ffc00u >> KILN_RADIOSITY_DROPPED;
    return (bits + (random10 & 1023u)) >> KILN_RADIOSITY_DROPPED;
}

/* Packs to 8 bytes. `hash` supplies 30 random bits; it must be a function of point and bounce, so that every rank packs
 * alike. */
static inline uint64_t kiln_radiosity_pack(const float rgb[3], uint32_t hash)
{
    return kiln_radiosity_pack_channel(rgb[0], hash) |
           kiln_radiosity_pack_channel(rgb[1], hash >> 10) << KILN_RADIOSITY_BITS |
           kiln_radiosity_pack_channel(rgb[2], hash >> 20) << (2 * KILN_RADIOSITY_BITS);
}

static inline void kiln_radiosity_unpack(uint64_t packed, float rgb[3])
{
    const uint32_t low = (uint32_t)packed, high = (uint32_t)(packed >> 32);
    const uint32_t bits[3] = {kiln_radiosity_red(low), kiln_radiosity_green(low, high), kiln_radiosity_blue(high)};
    memcpy(rgb, bits, sizeof bits);
}

/* Packed placeholder for unknown radiosity: NaN in the channels whose bit is set in `channels` (red 1, green 2, blue
 * 4), 0 in the others. Packing never produces this value. NaN spreads to all results: so a gather that reads it shows
 * this in its sums, at no extra cost. */
enum { KILN_RADIOSITY_ALL_CHANNELS = 7 };
static inline uint64_t kiln_radiosity_absent(uint32_t channels)
{
    uint64_t packed = 0;
    for (uint32_t c = 0; c < 3; c++)
        if ((channels >> c & 1u) != 0)
            packed |= (uint64_t)KILN_RADIOSITY_MASK << (c * KILN_RADIOSITY_BITS);
    return packed;
}

enum { KILN_COMPACT_BIAS = 41, KILN_COMPACT_EXPONENT = 63 };

/* 2^exponent; the result must be a normal double. */
static inline double kiln_power_of_two(int exponent)
{
    const uint64_t bits = (uint64_t)(exponent + 1023) << 52;
    double power;
    memcpy(&power, &bits, sizeof power);
    return power;
}

/* Divides a channel by its quantum, a power of two, and rounds up or down by 10 random bits; whole numbers do not
 * change. */
static inline uint32_t kiln_radiosity_compact_channel(float value, double per_quantum, uint32_t most, uint32_t random10)
{
    const double steps =
        value > 0.0f ? (double)value * per_quantum + ((double)(random10 & 1023u) + 0.5) * 0x1p-10 : 0.0;
    return steps < (double)most ? (uint32_t)steps : most;
}

/* Packs to 4 bytes. `scale`: a power of two near the scene's mean irradiance. `hash`: as for kiln_radiosity_pack. */
static inline uint32_t kiln_radiosity_compact(const float rgb[3], double scale, uint32_t hash)
{
    const double per_scale = 1.0 / scale,
                 limit = fmax((double)fmaxf(rgb[0], rgb[1]) / 511.0, (double)rgb[2] / 510.0) * per_scale;
    int exponent = 0;
    if (limit > 0.0 && isfinite(limit)) { /* the least exponent whose largest mantissa is enough */
        const double fraction = frexp(limit, &exponent);
        exponent += KILN_COMPACT_BIAS - (fraction > 0.5 ? 0 : 1);
    } else if (limit > 0.0) {
        exponent = KILN_COMPACT_EXPONENT;
    }
    exponent = exponent < 0 ? 0 : exponent > KILN_COMPACT_EXPONENT ? KILN_COMPACT_EXPONENT : exponent;
    const double per_quantum = per_scale * kiln_power_of_two(KILN_COMPACT_BIAS - exponent);
    return kiln_radiosity_compact_channel(rgb[0], per_quantum, 511, hash) |
           kiln_radiosity_compact_channel(rgb[1], per_quantum, 511, hash >> 10) << 9 |
           kiln_radiosity_compact_channel(rgb[2], 0.5 * per_quantum, 255, hash >> 20) << 18 | (uint32_t)exponent << 26;
}

static inline void kiln_radiosity_expand(uint32_t compact, double scale, float rgb[3])
{
    const double quantum = scale * kiln_power_of_two((int)(compact >> 26) - KILN_COMPACT_BIAS);
    rgb[0] = (float)((double)(compact & 511u) * quantum);
    rgb[1] = (float)((double)(compact >> 9 & 511u) * quantum);
    rgb[2] = (float)((double)(compact >> 18 & 255u) * 2.0 * quantum);
}

#endif
