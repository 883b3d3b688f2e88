#include "worker/pass/row_chains.h"

#include <xxhash.h>

uint32_t kiln_row_chain_check(uint64_t key, uint64_t point, const struct kiln_row_chain *record, const uint32_t *stream)
{
    const float floats[] = {record->escaped,  record->blocked,  record->glass[0], record->glass[1],
                            record->glass[2], record->gloss[0], record->gloss[1], record->gloss[2]};
    const uint64_t seed = XXH3_64bits_withSeed(floats, sizeof floats, key ^ (point * 0x9e3779b97f4a7c15u));
    const uint32_t check = (uint32_t)XXH3_64bits_withSeed(stream, (size_t)record->words * sizeof *stream, seed);
    return check != 0 ? check : 1;
}

#define MOST 1e12f /* limit of a weight, or of a sum over a point's samples: light must stay finite */

/* False for what is not finite, too. */
static bool are_within(const void *floats, size_t count)
{
    bool within = true;
    for (size_t i = 0; i < count; i++) {
        float value;
        memcpy(&value, (const char *)floats + i * sizeof value, sizeof value);
        within = within && value >= -MOST && value <= MOST;
    }
    return within;
}

/* Number of words of the chain whose points begin at `at`; 0: it is invalid. */
static uint64_t chain_words(const uint32_t *stream, uint64_t at, uint64_t words, uint64_t points)
{
    const uint64_t begin = at;
    while (at < words) {
        const uint32_t word = stream[at];
        const uint64_t size = 1 + ((word & KILN_CHAIN_GREY) != 0 ? 1 : 3);
        if ((word & KILN_CHAIN_POINTS) >= points || size > words - at || !are_within(stream + at + 1, size - 1))
            return 0;
        at += size;
        if ((word & KILN_CHAIN_LAST) != 0)
            return at - begin;
    }
    return 0;
}

bool kiln_row_chain_is_sound(const struct kiln_row_chain *record, const uint32_t *stream, const uint32_t *row,
                             uint32_t samples, uint64_t points)
{
    const uint64_t words = record->words;
    uint64_t at = 0;
    if (!are_within(&record->escaped, 1) || !are_within(&record->blocked, 1) || !are_within(record->glass, 3) ||
        !are_within(record->gloss, 3))
        return false;
    for (uint32_t k = 0; k < samples; k++) {
        if (row[k] != KILN_ROW_CHAIN && row[k] != KILN_ROW_TINTED)
            continue;
        if (row[k] == KILN_ROW_TINTED && (words - at < 3 || !are_within(stream + at, 3)))
            return false;
        at += row[k] == KILN_ROW_TINTED ? 3 : 0;
        const uint64_t size = chain_words(stream, at, words, points);
        if (size == 0)
            return false;
        at += size;
    }
    return at == words;
}
