/* Strip exchange: all ranks compress the strips of large lightmaps, and the owners of the lightmaps write them.
 *
 * An owner sends the values of a strip to its packer (strips.h) and receives the compressed bytes with their hash.
 * Between messages it compresses its own strips, and it writes all strips in order. A message is one strip. At most
 * KILN_STRIPS_ON_WAY strips of an owner have been sent but not written. A packer holds at most two strips for each
 * thread, and at most 0.5 GB unless two strips are larger than that. After a failure an owner sends empty messages in
 * place of the remaining strips, so that every rank reaches the end of its list and all return together. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_BANDS_STRIP_EXCHANGE_H
#define KILN_COORDINATOR_OUTPUT_MAP_BANDS_STRIP_EXCHANGE_H

#include <mpi.h>

#include "coordinator/job/faults.h"
#include "coordinator/output/exr_strips.h"
#include "coordinator/output/map/bands/strips.h"

enum { KILN_STRIPS_ON_WAY = 128 };

/* A finished image of this rank, and the file that has been begun for it. Both are borrowed. */
struct kiln_strip_source {
    uint32_t object;
    const struct kiln_image *image;
    struct kiln_exr_file *file;
};

/* Collective. `sources` are the objects of this rank whose strips are distributed, in the order of its stream. Every
 * file is published when its last strip has been written. `faults` (may be NULL) names the rank whose packing fails,
 * for tests. Returns the worst status of all ranks, with its message. */
int kiln_strips_write(MPI_Comm communicator, const struct kiln_strip_assignment *strips,
                      const struct kiln_lightmap *lightmaps, const struct kiln_strip_source *sources,
                      size_t source_count, const struct kiln_faults *faults, struct kiln_error *error);

#endif
