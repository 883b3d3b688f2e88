/* Keys of random sequences: hashes of the seed, of a tile or of a texel. The same in every backend. */
#ifndef KILN_WORKER_SAMPLING_KEYS_H
#define KILN_WORKER_SAMPLING_KEYS_H

#include <stdint.h>

#include "shaders/shared/random.h"
#include "shaders/shared/streams.h"

static inline uint32_t kiln_seed_key(uint64_t seed) { return kiln_hash2((uint32_t)seed, (uint32_t)(seed >> 32)); }

/* `texel` = y * width + x in the object's lightmap. */
static inline uint32_t kiln_texel_key(uint32_t seed_key, uint32_t object, uint64_t texel)
{
    return kiln_hash2(kiln_hash2(kiln_hash2(seed_key, object), (uint32_t)texel), (uint32_t)(texel >> 32) + 1u);
}

static inline uint32_t kiln_tile_key(uint32_t seed_key, uint32_t object, uint32_t tile)
{
    return kiln_hash2(kiln_hash2(seed_key ^ 0x74696c65u, object), tile);
}

/* Number of rays that share a position on the surface, for points that are more than one whole square: with more than
 * 64 samples it is above 1, since a position costs as much as a ray. Sample k starts at position k /
 * kiln_position_reuse(samples). */
static inline uint32_t kiln_position_reuse(uint32_t samples)
{
    return samples <= 64 ? 1 : samples < 256 ? (samples + 63) / 64 : 4;
}

#endif
