/* Writer of the columns of surface points in kiln.h5. Every rank compresses the chunks that begin with one of its
 * points, with all its threads, or reuses chunks packed ahead (points_ahead.h). Only rank 0 has the file open through
 * HDF5: it receives the sizes of all chunks and assigns their places, which takes microseconds (h5.h). Then every rank
 * writes its chunks in place. HDF5's own collective write runs the filters in one thread on each rank, which took
 * longer than computing the light. If a chunk ends with points of other ranks, its rank receives them first.
 *
 * A chunk's place depends on the sizes of all chunks before, so a rank packs all its chunks before it writes the first.
 * It keeps packed chunks up to its limit and packs the rest again. The bytes of the file do not depend on the number of
 * ranks or threads. */
#ifndef KILN_COORDINATOR_OUTPUT_KILN_H5_POINTS_H
#define KILN_COORDINATOR_OUTPUT_KILN_H5_POINTS_H

#include "coordinator/output/columns.h"
#include "coordinator/output/h5.h"
#include "coordinator/output/output.h"
#include "coordinator/output/points_ahead.h"

struct kiln_points_writer;

/* Most bytes of packed chunks that a rank keeps; a single rank keeps none. */
#define KILN_POINTS_KEPT_MOST (256ull << 20)

/* Collective. Needs about 120 MB of memory at most, plus the kept chunks. Uses of `params`: `ahead`, stopped, may be
 * NULL, has chunks that this rank need not pack; `kept` is the limit of kept bytes. */
int kiln_points_writer_create(struct kiln_points_writer **writer, const struct kiln_bake_result *result,
                              const struct kiln_output_params *params, struct kiln_error *error);
void kiln_points_writer_destroy(struct kiln_points_writer **writer);

/* Collective. `h5` is the open file of rank 0, in which the groups exist; other ranks pass NULL. `descriptor` opens
 * this file on each rank; `path` is for messages. */
int kiln_points_write(struct kiln_points_writer *writer, struct kiln_h5 *h5, int descriptor, const char *path,
                      struct kiln_error *error);

/* Collective, after the file has been closed. Checks the length of all columns, and compares all values of
 * /irradiance/total with the light of the points. */
int kiln_points_check(struct kiln_points_writer *writer, const struct kiln_publish *place, struct kiln_error *error);

/* Size of the columns in a file if nothing can be compressed, bytes. */
uint64_t kiln_points_largest(const struct kiln_field_set *fields, uint64_t points);

#endif
