/* Packing the strips of large lightmaps on all ranks, and writing them on their owners.
 *
 * An owner sends the values of a strip to who packs it (strips.h) and gets the packed bytes back with their hash; it
 * packs its own part between messages and writes all in order. A message is one strip. At most KILN_STRIPS_ON_WAY
 * strips are between being sent and being written; a packer holds two a thread and half a GB, or two in all where they
 * are larger. When something fails, an owner sends empty messages in place of the strips that are left, so that every
 * rank gets to the end of its list, and they leave together. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_STRIP_EXCHANGE_H
#define KILN_COORDINATOR_OUTPUT_MAP_STRIP_EXCHANGE_H

#include <mpi.h>

#include "coordinator/job/faults.h"
#include "coordinator/output/exr_strips.h"
#include "coordinator/output/map/strips.h"

enum { KILN_STRIPS_ON_WAY = 128 };

/* A finished image of this rank, and the file that was begun for it. Both are borrowed. */
struct kiln_strip_source {
    uint32_t object;
    const struct kiln_image *image;
    struct kiln_exr_file *file;
};

/* Collective. `faults` (may be NULL) says whose packing fails, for tests. `sources` are the rank's own divided objects,
 * in the order of its stream. Every file is published when its last strip is written. The worst status of all, with its
 * sentence. */
int kiln_strips_write(MPI_Comm communicator, const struct kiln_strip_deal *strips,
                      const struct kiln_lightmap *lightmaps, const struct kiln_strip_source *sources,
                      size_t source_count, const struct kiln_faults *faults, struct kiln_error *error);

#endif
