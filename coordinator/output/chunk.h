/* A chunk of an HDF5 dataset packed and unpacked outside of HDF5, so that threads can share the work: the bytes are
 * what its own filters "shuffle" and "deflate" (H5Pset_shuffle, H5Pset_deflate) stand for, and any reader undoes them.
 * HDF5 itself runs its filters in one thread. Not collective, thread-safe, deterministic. */
#ifndef KILN_COORDINATOR_OUTPUT_CHUNK_H
#define KILN_COORDINATOR_OUTPUT_CHUNK_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"

/* The most that kiln_chunk_pack makes of so many bytes. */
size_t kiln_chunk_bound(size_t bytes);

/* Packs `count` values of `size` bytes each. `noisy` leaves out the search for what stood before, which takes twice the
 * time and finds little among the low bytes of measured numbers; only runs are packed then, and frequent bytes get
 * short codes. `shuffled` has room for count x size bytes, `packed` for their bound; *packed_bytes is what was made.
 * KILN_SYSTEM without memory. */
int kiln_chunk_pack(const void *values, size_t count, size_t size, bool noisy, void *shuffled, void *packed,
                    size_t *packed_bytes, struct kiln_error *error);

/* The reverse; KILN_IO unless exactly count x size bytes come out. */
int kiln_chunk_unpack(const void *packed, size_t packed_bytes, size_t count, size_t size, void *shuffled, void *values,
                      struct kiln_error *error);

#endif
