/* OpenEXR files written by all ranks, each a band of rows in place. The bytes are the same as those of kiln_exr_write.
 *
 * A file of scanlines is a header, the table of the strips' offsets, and the strips (exr_strips.h). Each rank packs its
 * strips; their offset is the sum of sizes of the ranks before it. It writes the strips and its part of the table,
 * reads them back and compares hashes. One rank has created the file and written the header; it publishes the file when
 * all ranks have synced their parts. Until then the file has its temporary name (files/publish.h). */
#ifndef KILN_COORDINATOR_OUTPUT_EXR_BANDS_H
#define KILN_COORDINATOR_OUTPUT_EXR_BANDS_H

#include <mpi.h>
#include <stdbool.h>

#include "coordinator/output/exr.h"

/* Collective. `image` has this rank's rows, from `first_row` on, in the order of ranks: a whole number of strips,
 * except for the last; its height may be 0. `height` is that of the whole image. `fails`: packing fails on this rank,
 * for tests. All ranks return the worst status, with its message; on failure there is no file. */
int kiln_exr_write_bands(MPI_Comm communicator, const char *directory, const char *name, const struct kiln_image *image,
                         uint32_t first_row, uint32_t height, const struct kiln_exr_attribute *attributes,
                         size_t attribute_count, bool fails, struct kiln_error *error);

#endif
