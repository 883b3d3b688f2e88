/* Packs columns of kiln.h5 ahead of time, while light is computed. A few threads compress the columns that depend on
 * the surface alone: positions, normals, objects, texels, cells, albedo, areas; and, once it is known, direct light.
 * The writer of the file (kiln_h5_points.h) takes these chunks instead of packing them again; it takes chunks of light
 * only if the values have not changed since.
 *
 * The threads run at the lowest priority (nice 19, SCHED_BATCH). There are a quarter as many as the rank has threads,
 * at most four. If passes keep all processors busy they pack little; if a GPU traces they pack most. They write no file
 * and call neither HDF5 nor MPI: the packed chunks stay in memory, at most 512 MiB per rank. The bytes of kiln.h5 are
 * the same with and without them. Only chunks whose points all belong to the rank are packed. Not collective. */
#ifndef KILN_COORDINATOR_OUTPUT_POINTS_AHEAD_H
#define KILN_COORDINATOR_OUTPUT_POINTS_AHEAD_H

#include "coordinator/field/result.h"

/* Number of points in a chunk of kiln.h5; a file with fewer points has one chunk. */
enum { KILN_H5_CHUNK_ROWS = 1 << 14 };
/* Memory in bytes: the most packed data that a rank keeps; working memory of the threads (8 MB measured, plus a
 * reserve); packed data per point, measured. */
#define KILN_POINTS_AHEAD_MOST (512ull << 20)
#define KILN_POINTS_AHEAD_ROOM (10ull << 20)
#define KILN_POINTS_AHEAD_POINT 30.0

struct kiln_points_ahead;

/* Report on what was packed ahead. */
struct kiln_points_ahead_report {
    uint64_t chunks, of; /* chunks of surface columns: packed; all within the rank's points */
    uint64_t direct;     /* packed chunks of direct light */
    uint64_t bytes;      /* compressed */
    double begin, end;   /* s from the start: first chunk, last chunk */
    double processor;    /* processor time of all threads, s */
};

/* Starts the threads. The result needs only scene, geometry, surface, fields and data. The struct is copied; the data
 * that it points to must not change until kiln_points_ahead_stop. *ahead becomes NULL, which is no error, if there is
 * nothing to pack or too little memory. `threads`: number of threads of the rank. */
void kiln_points_ahead_start(struct kiln_points_ahead **ahead, const struct kiln_bake_result *result, uint32_t threads);
/* Announces that direct light is final: its columns are packed after those of the surface. NULL is allowed. */
void kiln_points_ahead_direct(struct kiln_points_ahead *ahead);
/* Ends the threads after their current chunks, which take a few milliseconds; packed chunks stay. NULL and a second
 * call are allowed. */
void kiln_points_ahead_stop(struct kiln_points_ahead *ahead);
/* Stops the threads and releases the packed chunks; the report remains. NULL is allowed. */
void kiln_points_ahead_drop(struct kiln_points_ahead *ahead);
/* Stops, releases and sets NULL. */
void kiln_points_ahead_destroy(struct kiln_points_ahead **ahead);

/* Returns a surface column of a chunk, compressed, or NULL if it was not packed. To be called after
 * kiln_points_ahead_stop. `ahead` may be NULL. */
const void *kiln_points_ahead_find(const struct kiln_points_ahead *ahead, uint64_t chunk, const char *column,
                                   size_t *bytes);
/* Returns a column of direct light of a chunk, compressed. NULL if it was not packed, or if `rows`, of `size` bytes,
 * are not the rows that were packed (by their hash). */
const void *kiln_points_ahead_find_direct(const struct kiln_points_ahead *ahead, uint64_t chunk, const char *column,
                                          const void *rows, size_t size, size_t *bytes);
/* Fills in the report; may be called at any time. All zero if `ahead` is NULL. The processor time is known only after
 * the threads are stopped. */
void kiln_points_ahead_report(const struct kiln_points_ahead *ahead, struct kiln_points_ahead_report *report);

#endif
