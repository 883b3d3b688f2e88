#include "worker/pass/rows.h"

#include <xxhash.h>

uint32_t kiln_rows_check(uint64_t key, uint64_t point, const uint32_t *words, uint32_t samples)
{
    const uint64_t seed = key ^ (point * 0x9e3779b97f4a7c15u) ^ ((uint64_t)samples << 48);
    const uint32_t check = (uint32_t)XXH3_64bits_withSeed(words, (size_t)samples * sizeof *words, seed);
    return check != 0 ? check : 1;
}
