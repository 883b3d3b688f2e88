/* Compression of HDF5 chunks outside of HDF5, by libdeflate, so that threads can share the work; HDF5 itself runs its
 * filters, which are slower, in one thread. The bytes are those of its filters "shuffle" and "deflate" (H5Pset_shuffle,
 * H5Pset_deflate), so any reader can decompress them. Not collective, thread-safe, deterministic. */
#ifndef KILN_COORDINATOR_OUTPUT_CHUNK_H
#define KILN_COORDINATOR_OUTPUT_CHUNK_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"

/* Largest compressed size of `bytes` bytes. */
size_t kiln_chunk_bound(size_t bytes);

/* Compresses `count` values of `size` bytes each. `noisy` shortens deflate's search for repeated strings, which finds
 * little among the low bytes of noisy numbers.
 * `shuffled` has room for count x size bytes, `packed` for kiln_chunk_bound of that; *packed_bytes receives the
 * compressed size. KILN_SYSTEM if memory is short. */
int kiln_chunk_pack(const void *values, size_t count, size_t size, bool noisy, void *shuffled, void *packed,
                    size_t *packed_bytes, struct kiln_error *error);

/* Decompresses; KILN_IO unless the result has exactly count x size bytes. */
int kiln_chunk_unpack(const void *packed, size_t packed_bytes, size_t count, size_t size, void *shuffled, void *values,
                      struct kiln_error *error);

#endif
