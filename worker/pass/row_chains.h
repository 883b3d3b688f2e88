/* Chains of kept rays: what rays bring that go on from mirrors, gloss and glass, or are tinted by what they pass
 * through, beside the rows (rows.h) whose words say which rays do.
 *
 * All that a chain (shaders/shared/chain.h) finds of light is a sum over the surface points that have sent it on: their
 * radiosity times a weight by colour. Points and weights hang on geometry and on the materials that the chain has met,
 * on no light. They make the stream of a point: 32-bit words, of each of its rays with KILN_ROW_CHAIN or
 * KILN_ROW_TINTED, in the order of samples,
 *
 *     KILN_ROW_TINTED alone: three floats, by which what the ray brings is multiplied
 *     of each point that sends something: its number, with KILN_CHAIN_GREY where one weight is for all colours and
 *     KILN_CHAIN_LAST at the chain's last; then one float, or three: the weights
 *
 * A file is of one step. After the header of rows, with a magic of its own, it has a record for each surface point in
 * the global order, and then the streams. While a bake is under way each rank adds the streams that it makes to a file
 * of its own, and its records say so; in the end all are moved behind the records, in the order of points, so that the
 * bytes hang on no number of ranks or threads (coordinator/integrate/relight/transport.h). */
#ifndef KILN_WORKER_PASS_ROW_CHAINS_H
#define KILN_WORKER_PASS_ROW_CHAINS_H

#include <string.h>

#include "worker/pass/rows.h"
#include "worker/scene/radiosity.h"

#define KILN_ROW_CHAINS_MAGIC "kilnchns"

/* Words of a row for rays with a part in the stream. */
#define KILN_ROW_CHAIN 0xfffffffcu
#define KILN_ROW_TINTED 0xfffffffbu

#define KILN_CHAIN_LAST 0x80000000u
#define KILN_CHAIN_GREY 0x40000000u
#define KILN_CHAIN_POINTS 0x3fffffffu /* so many surface points at most can be told apart */

/* Record of a point: where its stream is, and the part of its answer that hangs on no light (struct kiln_point_result).
 */
struct kiln_row_chain {
    uint32_t check; /* of all but `spool` and `at`, and of the stream; never 0 where the point has a row */
    uint32_t spool; /* the rank whose file has the stream; KILN_CHAIN_PACKED: it is behind the records */
    uint64_t at;    /* words before it, in that file, or behind the records */
    uint64_t words;
    float escaped, blocked, glass[3], gloss[3];
};
#define KILN_CHAIN_PACKED 0xffffffffu
_Static_assert(sizeof(struct kiln_row_chain) == 56, "the file has no gaps");

/* The chains of a step (struct kiln_rows). */
struct kiln_row_chains {
    int file, spool;      /* open descriptors; the second of this rank's own streams, -1 where rays are looked up */
    const char *path;     /* of the first, for messages */
    uint32_t number;      /* of this rank */
    uint64_t spool_words; /* in its file */
    uint64_t words, words_begin; /* behind the records, where rays are looked up; the bytes before them */
};

static inline uint64_t kiln_row_chain_offset(uint64_t point)
{
    return KILN_ROWS_BEGIN + point * sizeof(struct kiln_row_chain);
}

/* The check of a point: `stream` has record->words words. */
uint32_t kiln_row_chain_check(uint64_t key, uint64_t point, const struct kiln_row_chain *record,
                              const uint32_t *stream);

/* Whether a stream, of record->words words, has what the words of the row ask for, no more, and no point beyond
 * `points`; and whether all numbers of both are finite, and of a size that rays may bring. */
bool kiln_row_chain_is_sound(const struct kiln_row_chain *record, const uint32_t *stream, const uint32_t *row,
                             uint32_t samples, uint64_t points);

/* Finds the light that a ray with such a word brings, W/m2, by the radiosity of all points; returns where the stream
 * goes on. The stream is sound. Sums are those of chains that are traced. */
static inline const uint32_t *kiln_row_chain_light(const uint32_t *stream, bool tinted, const uint64_t *radiosity,
                                                   float rgb[3])
{
    const uint32_t *at = tinted ? stream + 3 : stream;
    uint32_t word;
    rgb[0] = rgb[1] = rgb[2] = 0.0f;
    do {
        float weight[3], found[3];
        word = *at++;
        const bool grey = (word & KILN_CHAIN_GREY) != 0;
        for (int c = 0; c < 3; c++)
            memcpy(&weight[c], grey ? at : at + c, sizeof weight[c]);
        at += grey ? 1 : 3;
        kiln_radiosity_unpack(radiosity[word & KILN_CHAIN_POINTS], found);
        for (int c = 0; c < 3; c++)
            rgb[c] += weight[c] * found[c];
    } while ((word & KILN_CHAIN_LAST) == 0);
    for (int c = 0; c < 3 && tinted; c++) {
        float tint;
        memcpy(&tint, stream + c, sizeof tint);
        rgb[c] *= tint;
    }
    return at;
}

#endif
