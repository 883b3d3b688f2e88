/* Rows: what the rays of the gather pass (gather.h) have met, kept in a file, so that the pass can be run again under
 * other light without a tracer.
 *
 * A file is of one step: one stream, one number of samples, one stretch of the sequence. After a header it has a row
 * for each surface point, in the global order: a 32-bit check, and 32 bits for each sample: the surface point whose
 * radiosity the ray read, or one of the words below. What the points of other ranks are is no matter, so all ranks
 * write one file, each where its points stand, and any number of ranks can read it. A point that no ray was asked of
 * has no row: its bytes are 0, on most file systems a hole.
 *
 * The check is a hash of key, point, number of samples and words, and never 0. The key is a hash of what the rays hang
 * on (coordinator/integrate/relight/transport.h), so a row of another bake is as good as damaged.
 *
 * What rays bring that go on from gloss, or are tinted, stands beside the rows (row_chains.h); Embree's backend alone
 * keeps that. Rows are of rays without radiance probes and without guide. Either backend keeps and replays them. Bits
 * are those of a bake where the same backend has kept and replays. */
#ifndef KILN_WORKER_PASS_ROWS_H
#define KILN_WORKER_PASS_ROWS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "shaders/shared/rows.h"
#include "worker/base/status.h"

#define KILN_ROWS_MAGIC "kilnrows"
enum { KILN_ROWS_VERSION = 1, KILN_ROWS_BEGIN = 4096 }; /* bytes before the first row */

/* Words for rays that met no surface point: KILN_ROW_... of shaders/shared/rows.h. */

/* The first bytes of a file; the rest up to KILN_ROWS_BEGIN is 0. */
struct kiln_rows_header {
    char magic[8];
    uint32_t version, samples, stream, first_sample;
    uint64_t points, key;
};

static inline uint64_t kiln_rows_row_bytes(uint32_t samples) { return 4 * (1 + (uint64_t)samples); }
static inline uint64_t kiln_rows_file_bytes(uint64_t points, uint32_t samples)
{
    return KILN_ROWS_BEGIN + points * kiln_rows_row_bytes(samples);
}

/* The check of a row: `words` has `samples` of them. */
uint32_t kiln_rows_check(uint64_t key, uint64_t point, const uint32_t *words, uint32_t samples);

struct kiln_resident_rows;
struct kiln_row_chains;

/* Rows of a step, and how a backend uses them (kiln_backend_set_rows). */
struct kiln_rows {
    int file;         /* an open descriptor; borrowed */
    const char *path; /* for messages; borrowed */
    /* NULL: they are in the file. Else they are here (resident_rows.h), with `replays`: rays without a row are traced,
     * and get one; and the weights of all are noted. Borrowed */
    struct kiln_resident_rows *resident;
    struct kiln_row_chains *chains; /* NULL: no ray goes on, and none is tinted. Borrowed */
    bool replays;     /* rays are looked up, and traced where there is no row; else all are traced and kept */
    uint32_t samples; /* of a row; a batch may have fewer */
    uint64_t key;
    /* what has come of it: rays that were kept, or found in the file; rays that were traced for want of a row */
    uint64_t kept, found, traced;
    /* a file that cannot be read or written, or is damaged; else KILN_OK */
    int status;
    struct kiln_error error;
};

/* Notes in r->status, if nothing is there yet, what failed with a row; `what` is "read", "write", or with
 * KILN_BAD_INPUT what the row is: "damaged". Threads may call it. */
void kiln_rows_fail(struct kiln_rows *r, int status, const char *what, uint64_t point);

/* Reads rows, of `points` points from `point` on in the global order, each of `samples` samples: r->samples, or fewer
 * of one point alone. False: the file has not so many, or it failed, which r->status says. Threads may call these. */
bool kiln_rows_load(struct kiln_rows *r, uint32_t *rows, uint64_t point, uint64_t points, uint32_t samples);
/* Whether a point that was read has a row, of a surface of so many points; r->status says when it is damaged. */
bool kiln_rows_there(struct kiln_rows *r, const uint32_t *row, uint64_t point, uint32_t samples,
                     uint64_t surface_points);
/* Writes rows whose checks are set, as kiln_rows_load. */
bool kiln_rows_store(struct kiln_rows *r, const uint32_t *rows, uint64_t point, uint64_t points, uint32_t samples);

#endif
