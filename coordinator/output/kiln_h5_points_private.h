/* Internals of the writer of the points' columns (kiln_h5_points.h): distribution of chunks over ranks, packing,
 * placing, writing and reading back. A part is one column of one chunk; the parts of a rank's chunks have consecutive
 * numbers, chunk by chunk and in each chunk column by column, which is also the order of the file. A batch is a number
 * of consecutive chunks of a rank that are in memory together, each part in its slot. */
#ifndef KILN_COORDINATOR_OUTPUT_KILN_H5_POINTS_PRIVATE_H
#define KILN_COORDINATOR_OUTPUT_KILN_H5_POINTS_PRIVATE_H

#include "coordinator/output/kiln_h5_points.h"
#include "worker/base/arena.h"

/* The dataset that is read back completely. */
#define POINTS_TOTAL "/irradiance/total"

struct kiln_points_writer {
    const struct kiln_bake_result *result;
    const struct kiln_points_ahead *ahead; /* NULL: none */
    struct kiln_h5 *h5;                    /* rank 0 */
    int rank, ranks;
    uint64_t chunk_rows, at_once; /* at_once: chunks of a batch at most */
    uint64_t *starts;             /* global index of the first point of each rank; ranks + 1 entries */
    struct kiln_columns columns;
    size_t total; /* index of the column POINTS_TOTAL */
    hid_t datasets[KILN_COLUMNS_MAX];
    struct kiln_column_values rows, tail; /* rows of the batch; rows of the last own chunk received from later ranks */
    /* packed: one slot for each part of a batch; spare: the previous batch, which is being written */
    uint8_t *packed, *spare;
    uint8_t *shuffled; /* of each thread, shuffled_bytes */
    size_t shuffled_bytes;
    int threads;
    uint64_t first, count; /* chunks of the batch */
    /* for each own part: number of compressed bytes; address in the file; copy of the bytes, NULL: packed again for
     * writing */
    uint32_t *sizes;
    uint64_t *addresses;
    void **kept;
    uint64_t kept_bytes, kept_most;
    /* rank 0: sizes and addresses of another rank's parts, one rank after the other */
    uint32_t *their_sizes;
    uint64_t *their_addresses;
    struct kiln_arena arena;
};

static inline const struct kiln_column *points_column(const struct kiln_points_writer *w, size_t column)
{
    return &w->columns.column[column];
}

static inline uint64_t points_minimum(uint64_t a, uint64_t b) { return a < b ? a : b; }

/* The number of the first chunk that begins with a point of the rank or of a later one. */
uint64_t points_first_chunk(const struct kiln_points_writer *w, int rank);
/* The number of parts that a rank has. */
uint64_t points_parts(const struct kiln_points_writer *w, int rank);

/* Selects the rank's batch number `pass`. False if there is none any more. */
bool points_batch(struct kiln_points_writer *w, uint64_t pass);
/* Number of the part in slot `slot` of the batch, and the slot's offset in `packed`. */
uint64_t points_part(const struct kiln_points_writer *w, size_t slot);
size_t points_slot(const struct kiln_points_writer *w, size_t slot);
/* The compressed bytes of an own part, if they were packed ahead. */
const void *points_ahead_part(const struct kiln_points_writer *w, uint64_t part, size_t *bytes);
/* Working memory for one part, of the calling thread, one of `w->threads`. */
uint8_t *points_shuffled(const struct kiln_points_writer *w);

/* Collective. Sends points at chunk borders to the ranks whose chunks end with them. A rank first sends to an earlier
 * one and then receives from later ones, which prevents deadlock. */
int points_share_borders(struct kiln_points_writer *w, struct kiln_error *error);

/* Compresses the parts of the batch that are neither kept nor packed ahead, and stores their sizes. Keeps their bytes
 * if the writer is one of several and below its limit. */
int points_pack(struct kiln_points_writer *w, struct kiln_error *error);

/* KILN_RANK_LOST, with its message. */
int points_mpi_failed(struct kiln_error *error);

#endif
