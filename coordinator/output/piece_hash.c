#include "coordinator/output/piece_hash.h"

#include <endian.h>
#include <errno.h>
#include <unistd.h>
#include <xxhash.h>

#include "worker/base/memory.h"

enum { READ_BYTES = 1 << 18 }; /* stay in the cache between reading and hashing */

uint64_t kiln_hash_piece_count(uint64_t file_bytes, uint64_t piece_bytes)
{
    return file_bytes <= piece_bytes ? 1 : (file_bytes - 1) / piece_bytes + 1;
}

/* Hashes the bytes from `at` up to `end`. */
static int read_piece(int descriptor, const char *path, uint64_t at, uint64_t end, char *buffer, XXH3_state_t *state,
                      struct kiln_error *error)
{
    while (at < end) {
        const size_t step = end - at < READ_BYTES ? (size_t)(end - at) : READ_BYTES;
        const ssize_t got = pread(descriptor, buffer, step, (off_t)at);
        if (got < 0 && errno == EINTR)
            continue;
        if (got < 0)
            return kiln_fail_errno(error, KILN_IO, "'%s' cannot be read at byte %llu", path, (unsigned long long)at);
        if (got == 0)
            return kiln_fail(error, KILN_IO, "'%s' ended at byte %llu while it was read", path, (unsigned long long)at);
        (void)XXH3_128bits_update(state, buffer, (size_t)got);
        at += (uint64_t)got;
    }
    return KILN_OK;
}

int kiln_piece_hash(int descriptor, const char *path, uint64_t file_bytes, uint64_t piece_bytes, uint64_t piece,
                    struct kiln_hash *hash, struct kiln_error *error)
{
    const uint64_t begin = piece * piece_bytes, left = file_bytes - begin;
    char *buffer = NULL;
    XXH3_state_t *state = XXH3_createState();
    int status;
    KILN_TRY(state == NULL ? kiln_fail(error, KILN_SYSTEM, "out of memory: the hash of '%s'", path) : KILN_OK);
    KILN_TRY(kiln_allocate(&buffer, READ_BYTES, 1, "a file's bytes", error));
    (void)XXH3_128bits_reset(state);
    KILN_TRY(
        read_piece(descriptor, path, begin, begin + (left < piece_bytes ? left : piece_bytes), buffer, state, error));
    const XXH128_hash_t found = XXH3_128bits_digest(state);
    *hash = (struct kiln_hash){found.high64, found.low64};
end:
    (void)XXH3_freeState(state);
    kiln_free(&buffer);
    return status;
}

struct kiln_hash kiln_piece_hash_join(struct kiln_hash *pieces, uint64_t count)
{
    if (count == 1)
        return pieces[0];
    for (uint64_t i = 0; i < count; i++)
        pieces[i] = (struct kiln_hash){htobe64(pieces[i].high), htobe64(pieces[i].low)};
    const XXH128_hash_t found = XXH3_128bits(pieces, count * sizeof *pieces);
    return (struct kiln_hash){found.high64, found.low64};
}

int kiln_piece_hash_file(int descriptor, const char *path, uint64_t file_bytes, uint64_t piece_bytes,
                         struct kiln_hash *hash, struct kiln_error *error)
{
    const uint64_t count = kiln_hash_piece_count(file_bytes, piece_bytes);
    uint64_t first_failed = count; /* its error is reported: a file that is too short ends in this piece */
    struct kiln_hash *pieces = NULL;
    int status = kiln_allocate(&pieces, count, sizeof *pieces, "a file's hashes", error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for schedule(dynamic, 1) if (count > 1)
    for (uint64_t i = 0; i < count; i++) {
        struct kiln_error own;
        const int failed = kiln_piece_hash(descriptor, path, file_bytes, piece_bytes, i, &pieces[i], &own);
#pragma omp critical(kiln_piece_hash)
        if (failed != KILN_OK && i < first_failed) {
            first_failed = i;
            status = kiln_fail(error, failed, "%s", own.message);
        }
    }
    if (status == KILN_OK)
        *hash = kiln_piece_hash_join(pieces, count);
    kiln_free(&pieces);
    return status;
}
