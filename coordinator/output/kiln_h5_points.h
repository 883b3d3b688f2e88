/* The columns of surface points in kiln.h5. Every rank packs the chunks that begin with one of its points, on all its
 * threads, and hands them to rank 0, which alone writes the file: HDF5 runs the filters of a collective write in one
 * thread a rank, and that took longer than the light. A chunk that ends with other ranks' points gets them from these
 * first. Values and chunks do not depend on the number of ranks or threads; the order of chunks in the file does on the
 * ranks. */
#ifndef KILN_COORDINATOR_OUTPUT_KILN_H5_POINTS_H
#define KILN_COORDINATOR_OUTPUT_KILN_H5_POINTS_H

#include "coordinator/output/columns.h"
#include "coordinator/output/h5.h"

struct kiln_points_writer;

/* Collective. Needs some 120 MB at most. */
int kiln_points_writer_create(struct kiln_points_writer **writer, const struct kiln_bake_result *result,
                              struct kiln_error *error);
void kiln_points_writer_destroy(struct kiln_points_writer **writer);

/* Collective. `h5` is rank 0's open file, with the groups made; other ranks give NULL. */
int kiln_points_write(struct kiln_points_writer *writer, struct kiln_h5 *h5, struct kiln_error *error);

/* Collective, after the file was closed. All columns must be as long as they should, and the whole of /irradiance/total
 * what it was made from. */
int kiln_points_check(struct kiln_points_writer *writer, const struct kiln_publish *place, struct kiln_error *error);

/* What the columns take in a file if nothing can be compressed. */
uint64_t kiln_points_largest(const struct kiln_field_set *fields, uint64_t points);

#endif
