/* OpenEXR files of which each rank writes a band of rows in place. The bytes are the same as those of kiln_exr_write.
 *
 * A file of scanlines is a header, the table of where its strips begin, and the strips (exr_strips.h). Each rank packs
 * its strips; a sum over the sizes of the ranks before it says where they go, and it writes them and their part of the
 * table. It reads them back and compares hashes. One rank has created the file and written the header; it publishes the
 * file when all ranks have synced their parts. Until then the file has its temporary name (files/publish.h). */
#ifndef KILN_COORDINATOR_OUTPUT_EXR_BANDS_H
#define KILN_COORDINATOR_OUTPUT_EXR_BANDS_H

#include <mpi.h>
#include <stdbool.h>

#include "coordinator/output/exr.h"

/* Collective. `image` has the rows from `first_row` on, a whole number of strips unless they are the last, in the order
 * of ranks; its height may be 0. `height` is that of the whole image. `fails`: packing fails on this rank, for tests.
 * All ranks return the worst status, with its message; the file is not there then. */
int kiln_exr_write_bands(MPI_Comm communicator, const char *directory, const char *name, const struct kiln_image *image,
                         uint32_t first_row, uint32_t height, const struct kiln_exr_attribute *attributes,
                         size_t attribute_count, bool fails, struct kiln_error *error);

#endif
