/* Chains of kept rays: the light of rays that go on from mirrors, gloss and glass, or that tinted surfaces attenuate.
 * They are stored beside the rows (rows.h), whose words mark these rays.
 *
 * The light that a chain (shaders/shared/chain.h) collects is a sum over surface points: their radiosity times a weight
 * by colour. Points and weights depend on geometry and materials, not on lights. They form the stream of a point:
 * 32-bit words for each of its rays with KILN_ROW_CHAIN or KILN_ROW_TINTED, in the order of samples,
 *
 *     KILN_ROW_TINTED alone: three floats, by which what the ray brings is multiplied
 *     of each point that sends something: its number, with KILN_CHAIN_GREY where one weight is for all colours and
 *     KILN_CHAIN_LAST at the chain's last; then one float, or three: the weights
 *
 * A file is of one step. After the header of rows, with a magic of its own, it has a record for each surface point in
 * the global order, and then the streams. During a bake each rank appends its streams to a file of its own (the spool),
 * which the records name. At the end all streams are moved behind the records, in the order of points, so that the
 * bytes do not depend on the number of ranks or threads (coordinator/integrate/relight/transport.h). */
#ifndef KILN_WORKER_PASS_ROW_CHAINS_H
#define KILN_WORKER_PASS_ROW_CHAINS_H

#include <string.h>

#include "worker/pass/rows.h"
#include "worker/scene/radiosity.h"

#define KILN_ROW_CHAINS_MAGIC "kilnchns"

/* Words of a row that mark rays with an entry in the stream. */
#define KILN_ROW_CHAIN 0xfffffffcu
#define KILN_ROW_TINTED 0xfffffffbu

#define KILN_CHAIN_LAST 0x80000000u
#define KILN_CHAIN_GREY 0x40000000u
#define KILN_CHAIN_POINTS 0x3fffffffu /* highest number of a surface point */

/* Record of a point: the place of its stream, and the part of its result that does not depend on lights (struct
 * kiln_point_result). */
struct kiln_row_chain {
    uint32_t check; /* hash of all members but `spool` and `at`, and of the stream; not 0 if the point has a row */
    uint32_t spool; /* rank whose file has the stream; KILN_CHAIN_PACKED: behind the records */
    uint64_t at;    /* start of the stream, in words from the file's begin or the records' end */
    uint64_t words;
    float escaped, blocked, glass[3], gloss[3];
};
#define KILN_CHAIN_PACKED 0xffffffffu
_Static_assert(sizeof(struct kiln_row_chain) == 56, "the file has no gaps");

/* The chains of a step (struct kiln_rows). */
struct kiln_row_chains {
    int file, spool;             /* descriptors: main file; this rank's streams, -1 if rays are looked up */
    const char *path;            /* of the first, for messages */
    uint32_t number;             /* of this rank */
    uint64_t spool_words;        /* in its file */
    uint64_t words, words_begin; /* looked-up streams: words, and their byte offset */
};

static inline uint64_t kiln_row_chain_offset(uint64_t point)
{
    return KILN_ROWS_BEGIN + point * sizeof(struct kiln_row_chain);
}

/* Computes the check of a point; `stream` has record->words words. */
uint32_t kiln_row_chain_check(uint64_t key, uint64_t point, const struct kiln_row_chain *record,
                              const uint32_t *stream);

/* Whether a stream of record->words words is valid: it has exactly the entries that the row's words ask for, no point
 * beyond `points`, and all numbers of record and stream are finite and of a size that rays may bring. */
bool kiln_row_chain_is_sound(const struct kiln_row_chain *record, const uint32_t *stream, const uint32_t *row,
                             uint32_t samples, uint64_t points);

/* Computes the light of a ray with an entry in the stream, W/m2, from the radiosity of all points; returns the start of
 * the next entry. The stream must be valid. Sums have the same bits as for traced chains. */
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
