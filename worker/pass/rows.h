/* Rows: the hits of the gather pass's rays (gather.h), kept in a file, so that the pass can be run again under other
 * light without tracing.
 *
 * A file is of one step: one stream, one number of samples, one stretch of the sequence. After a header it has a row
 * for each surface point, in the global order: a 32-bit check, and 32 bits for each sample: the surface point whose
 * radiosity the ray read, or one of the words below. Rows are independent of each other, so all ranks write one file,
 * each at the places of its points, and any number of ranks can read it. A point without rays has no row: its bytes are
 * 0, on most file systems a hole.
 *
 * The check is a hash of key, point, number of samples and words, and never 0. The key is a hash of all inputs of the
 * rays (coordinator/integrate/relight/transport.h), so a row of another bake counts as damaged.
 *
 * Light of rays that go on from gloss, or are tinted, is stored beside the rows (row_chains.h), by the Embree backend
 * only. Rows need rays without radiance probes and without guide. Both backends keep and replay rows; bits are the same
 * if one backend does both. */
#ifndef KILN_WORKER_PASS_ROWS_H
#define KILN_WORKER_PASS_ROWS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "shaders/shared/rows.h"
#include "worker/base/status.h"

#define KILN_ROWS_MAGIC "kilnrows"
enum { KILN_ROWS_VERSION = 1, KILN_ROWS_BEGIN = 4096 }; /* bytes before the first row */

/* Words of a row for rays that hit no surface point: KILN_ROW_... of shaders/shared/rows.h. */

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

/* Computes the check of a row of `samples` words. */
uint32_t kiln_rows_check(uint64_t key, uint64_t point, const uint32_t *words, uint32_t samples);

struct kiln_resident_rows;
struct kiln_row_chains;

/* Rows of a step, and their use by a backend (kiln_backend_set_rows). */
struct kiln_rows {
    int file;         /* an open descriptor; borrowed */
    const char *path; /* for messages; borrowed */
    /* NULL: rows are in the file. Else they are in this memory (resident_rows.h), with `replays`: rays without a row
     * are traced and get one, and the weights of all rays are stored. Borrowed */
    struct kiln_resident_rows *resident;
    struct kiln_row_chains *chains; /* NULL: no ray has a chain or a tint. Borrowed */
    bool replays;                   /* look rays up, and trace those without a row; else trace and keep all */
    uint32_t samples;               /* of a row; a batch may have fewer */
    uint64_t key;
    /* counts of rays: kept, found in the file, traced because they had no row */
    uint64_t kept, found, traced;
    /* KILN_OK, or why the file could not be read or written, or is damaged */
    int status;
    struct kiln_error error;
};

/* Records the first failure of a row in r->status; `what` is "read" or "write", or with KILN_BAD_INPUT the row's
 * defect: "damaged". Thread-safe. */
void kiln_rows_fail(struct kiln_rows *r, int status, const char *what, uint64_t point);

/* Reads the rows of `points` points from `point` on, in the global order. `samples`: r->samples, or fewer for a single
 * point. False: the file is too short, or reading failed (r->status). Thread-safe, as are the next two. */
bool kiln_rows_load(struct kiln_rows *r, uint32_t *rows, uint64_t point, uint64_t points, uint32_t samples);
/* Whether a point that was read has a row, of a surface with `surface_points` points. Damage is recorded in r->status.
 */
bool kiln_rows_there(struct kiln_rows *r, const uint32_t *row, uint64_t point, uint32_t samples,
                     uint64_t surface_points);
/* Writes rows whose checks are set; arguments and result as for kiln_rows_load. */
bool kiln_rows_store(struct kiln_rows *r, const uint32_t *rows, uint64_t point, uint64_t points, uint32_t samples);

#endif
