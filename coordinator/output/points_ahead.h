/* Packs columns of kiln.h5 ahead of time: while light is computed, a few threads compress what the surface alone tells
 * of the points: positions, normals, objects, texels, cells, albedo, areas; and once there is direct light, its
 * columns. When the file is written, its writer (kiln_h5_points.h) takes these chunks instead of packing them; of light
 * only where the values are still those that were packed.
 *
 * The threads give way: they run at the lowest priority (nice 19, SCHED_BATCH), a quarter as many as the rank has, four
 * at most. Where the passes leave no processor idle they pack little, and where a GPU traces they pack most. They write
 * no file and call neither HDF5 nor MPI: what they pack stays in memory, 512 MiB a rank at most. The bytes of kiln.h5
 * are the same with and without them. Only chunks are packed whose points are all the rank's. Not collective. */
#ifndef KILN_COORDINATOR_OUTPUT_POINTS_AHEAD_H
#define KILN_COORDINATOR_OUTPUT_POINTS_AHEAD_H

#include "coordinator/field/result.h"

/* Points of a chunk of kiln.h5; a file of fewer has one chunk. */
enum { KILN_H5_CHUNK_ROWS = 1 << 14 };
/* Bytes: what a rank keeps at most; what its threads work with, 8 MB measured and some more; what it keeps of a
 * point, measured. */
#define KILN_POINTS_AHEAD_MOST (512ull << 20)
#define KILN_POINTS_AHEAD_ROOM (10ull << 20)
#define KILN_POINTS_AHEAD_POINT 30.0

struct kiln_points_ahead;

/* Report on what was packed ahead. */
struct kiln_points_ahead_report {
    uint64_t chunks, of; /* packed, of what the surface tells; that lie within the rank's points */
    uint64_t direct;     /* packed, of direct light */
    uint64_t bytes;      /* compressed */
    double begin, end;   /* s from the start: of the first chunk, of the last */
    double processor;    /* s, all threads */
};

/* Starts the threads. The result need not have more than scene, geometry, surface, fields and data; it is copied, and
 * what it points to must stay as it is until kiln_points_ahead_stop. NULL in *ahead, which is no error: there is
 * nothing to pack, or too little memory. `threads`: of the rank. */
void kiln_points_ahead_start(struct kiln_points_ahead **ahead, const struct kiln_bake_result *result, uint32_t threads);
/* From now on direct light is what it will be: its columns are packed after those of the surface. NULL is allowed. */
void kiln_points_ahead_direct(struct kiln_points_ahead *ahead);
/* Ends the threads after the chunks that they are at, a few milliseconds of the processor; what is packed stays. NULL
 * and a second call are allowed. */
void kiln_points_ahead_stop(struct kiln_points_ahead *ahead);
/* Stops, and releases what was packed; the report remains. NULL is allowed. */
void kiln_points_ahead_drop(struct kiln_points_ahead *ahead);
/* Stops, releases and sets NULL. */
void kiln_points_ahead_destroy(struct kiln_points_ahead **ahead);

/* After kiln_points_ahead_stop. The chunk's column of the surface, compressed, or NULL if it is not there. `ahead` may
 * be NULL. */
const void *kiln_points_ahead_find(const struct kiln_points_ahead *ahead, uint64_t chunk, const char *column,
                                   size_t *bytes);
/* The same of a column of direct light: NULL also if the chunk's rows, of `size` bytes, are not those that were packed
 * (by their hash). */
const void *kiln_points_ahead_find_direct(const struct kiln_points_ahead *ahead, uint64_t chunk, const char *column,
                                          const void *rows, size_t size, size_t *bytes);
/* At any time; all zero if `ahead` is NULL, and the processor's time once the threads are stopped. */
void kiln_points_ahead_report(const struct kiln_points_ahead *ahead, struct kiln_points_ahead_report *report);

#endif
