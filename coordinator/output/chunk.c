#include "coordinator/output/chunk.h"

#include <string.h>
#include <zlib.h>

/* Deflate level 1 compresses shuffled floats to within 1 % of level 9, at several times its speed. */
enum { LEVEL = 1 };

/* Byte transposition: byte 0 of all values, then byte 1 of all values, and so on. */
static void shuffle(const uint8_t *values, size_t count, size_t size, uint8_t *planes)
{
    for (size_t b = 0; b < size; b++)
        for (size_t i = 0; i < count; i++)
            planes[b * count + i] = values[i * size + b];
}

static void unshuffle(const uint8_t *planes, size_t count, size_t size, uint8_t *values)
{
    for (size_t b = 0; b < size; b++)
        for (size_t i = 0; i < count; i++)
            values[i * size + b] = planes[b * count + i];
}

size_t kiln_chunk_bound(size_t bytes) { return compressBound((uLong)bytes); }

int kiln_chunk_pack(const void *values, size_t count, size_t size, bool noisy, void *shuffled, void *packed,
                    size_t *packed_bytes, struct kiln_error *error)
{
    z_stream stream = {.next_in = shuffled,
                       .avail_in = (uInt)(count * size),
                       .next_out = packed,
                       .avail_out = (uInt)kiln_chunk_bound(count * size)};
    enum { WINDOW_BITS = 15, MEMORY_LEVEL = 8 }; /* the parameters of compress2 */
    shuffle(values, count, size, shuffled);
    if (deflateInit2(&stream, LEVEL, Z_DEFLATED, WINDOW_BITS, MEMORY_LEVEL, noisy ? Z_RLE : Z_DEFAULT_STRATEGY) != Z_OK)
        return kiln_fail(error, KILN_SYSTEM, "zlib cannot compress %zu bytes: out of memory", count * size);
    const int done = deflate(&stream, Z_FINISH);
    *packed_bytes = stream.total_out;
    (void)deflateEnd(&stream);
    return done == Z_STREAM_END
               ? KILN_OK
               : kiln_fail(error, KILN_BUG, "zlib compresses %zu bytes to more than its bound", count * size);
}

int kiln_chunk_unpack(const void *packed, size_t packed_bytes, size_t count, size_t size, void *shuffled, void *values,
                      struct kiln_error *error)
{
    uLongf length = (uLong)(count * size);
    if (uncompress(shuffled, &length, packed, (uLong)packed_bytes) != Z_OK || length != count * size)
        return kiln_fail(error, KILN_IO, "%zu compressed bytes do not give the %zu bytes of a chunk", packed_bytes,
                         count * size);
    unshuffle(shuffled, count, size, values);
    return KILN_OK;
}
