/* Hash of a file in pieces, which ranks and threads hash in parallel. Each piece has an XXH3-128 hash of 16 bytes in
 * canonical (big-endian) form. The hash of the file is the XXH3-128 hash of their concatenation; a file of one piece
 * has the hash of that piece. Not collective, thread-safe. */
#ifndef KILN_COORDINATOR_OUTPUT_PIECE_HASH_H
#define KILN_COORDINATOR_OUTPUT_PIECE_HASH_H

#include <stdint.h>

#include "worker/base/status.h"

/* Bytes of a piece; the last has fewer. */
#define KILN_PIECE_BYTES ((uint64_t)4 << 20)

struct kiln_hash {
    uint64_t high, low;
};

/* Number of pieces of a file; at least 1, since an empty file has a hash too. */
uint64_t kiln_hash_piece_count(uint64_t file_bytes, uint64_t piece_bytes);

/* The hash of piece number `piece` of an open file. KILN_IO if it cannot be read, or ends before. */
int kiln_piece_hash(int descriptor, const char *path, uint64_t file_bytes, uint64_t piece_bytes, uint64_t piece,
                    struct kiln_hash *hash, struct kiln_error *error);
/* Hash of the file by its pieces. Changes the order of bytes in `pieces`. */
struct kiln_hash kiln_piece_hash_join(struct kiln_hash *pieces, uint64_t count);

/* The hash of an open file, by all threads. With pieces of UINT64_MAX bytes it is the plain hash of the file. */
int kiln_piece_hash_file(int descriptor, const char *path, uint64_t file_bytes, uint64_t piece_bytes,
                         struct kiln_hash *hash, struct kiln_error *error);

#endif
