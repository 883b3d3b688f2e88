#include "coordinator/output/exr_zip.h"

#include <libdeflate.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#include "worker/base/memory.h"

/* Level 1 compresses lightmaps to within 1 % of level 6, in little more than half the time. */
enum { LEVEL = 1 };

struct exr_zip {
    struct libdeflate_compressor *compressor;     /* made when it is first needed */
    struct libdeflate_decompressor *decompressor; /* likewise */
    /* a chunk with even bytes first, then its differences; compressed chunk */
    uint8_t *split, *packed;
    size_t split_capacity, packed_capacity;
};

struct exr_zip *exr_zip_create(void)
{
    struct exr_zip *zip = NULL;
    (void)kiln_allocate(&zip, 1, sizeof *zip, "compression of OpenEXR", NULL);
    return zip;
}

void exr_zip_destroy(struct exr_zip **zip)
{
    struct exr_zip *z = *zip;
    if (z == NULL)
        return;
    libdeflate_free_compressor(z->compressor);
    libdeflate_free_decompressor(z->decompressor);
    kiln_free(&z->split);
    kiln_free(&z->packed);
    kiln_free(zip);
}

/* Room for `size` bytes in `*buffer`. */
static bool has_room(uint8_t **buffer, size_t *capacity, size_t size)
{
    return kiln_grow(buffer, capacity, size, 1, "a chunk of OpenEXR", NULL) == KILN_OK;
}

/* ---- prediction ---- */

static void split(const uint8_t *restrict bytes, size_t size, uint8_t *restrict halves)
{
    uint8_t *restrict odd = halves + (size + 1) / 2;
    for (size_t i = 0; i < size / 2; i++) {
        halves[i] = bytes[2 * i];
        odd[i] = bytes[2 * i + 1];
    }
    if (size % 2 != 0)
        halves[size / 2] = bytes[size - 1];
}

static void join(const uint8_t *restrict halves, size_t size, uint8_t *restrict bytes)
{
    const uint8_t *restrict odd = halves + (size + 1) / 2;
    for (size_t i = 0; i < size / 2; i++) {
        bytes[2 * i] = halves[i];
        bytes[2 * i + 1] = odd[i];
    }
    if (size % 2 != 0)
        bytes[size - 1] = halves[size / 2];
}

static void to_differences(const uint8_t *restrict bytes, size_t size, uint8_t *restrict differences)
{
    differences[0] = bytes[0];
    for (size_t i = 1; i < size; i++)
        differences[i] = (uint8_t)(bytes[i] - bytes[i - 1] + 128);
}

static void from_differences(uint8_t *bytes, size_t size)
{
    uint8_t last = bytes[0];
    for (size_t i = 1; i < size; i++)
        bytes[i] = last = (uint8_t)(last + bytes[i] - 128);
}

/* ---- pipelines ---- */

static exr_result_t pack(exr_encode_pipeline_t *encoder)
{
    struct exr_zip *z = encoder->encoding_user_data;
    const size_t size = encoder->packed_bytes;
    if (z->compressor == NULL)
        z->compressor = libdeflate_alloc_compressor(LEVEL);
    /* the second half of `split` takes the differences */
    if (size == 0 || z->compressor == NULL || !has_room(&z->split, &z->split_capacity, 2 * size) ||
        !has_room(&z->packed, &z->packed_capacity, size))
        return size == 0 ? EXR_ERR_INVALID_ARGUMENT : EXR_ERR_OUT_OF_MEMORY;
    split(encoder->packed_buffer, size, z->split);
    to_differences(z->split, size, z->split + size);
    const size_t packed = libdeflate_zlib_compress(z->compressor, z->split + size, size, z->packed, size - 1);
    encoder->compressed_buffer = packed > 0 ? z->packed : encoder->packed_buffer;
    encoder->compressed_bytes = packed > 0 ? packed : size;
    encoder->compressed_alloc_size = 0; /* the library does not free it */
    return EXR_ERR_SUCCESS;
}

static exr_result_t unpack(exr_decode_pipeline_t *decoder)
{
    struct exr_zip *z = decoder->decoding_user_data;
    const size_t packed = decoder->chunk.packed_size, size = decoder->chunk.unpacked_size;
    if (size == 0 || decoder->packed_buffer == NULL || decoder->unpacked_buffer == NULL)
        return EXR_ERR_CORRUPT_CHUNK;
    if (packed == size) { /* stored as it is */
        if (decoder->unpacked_buffer != decoder->packed_buffer)
            memcpy(decoder->unpacked_buffer, decoder->packed_buffer, size);
        return EXR_ERR_SUCCESS;
    }
    if (z->decompressor == NULL)
        z->decompressor = libdeflate_alloc_decompressor();
    if (z->decompressor == NULL || !has_room(&z->split, &z->split_capacity, size))
        return EXR_ERR_OUT_OF_MEMORY;
    if (libdeflate_zlib_decompress(z->decompressor, decoder->packed_buffer, packed, z->split, size, NULL) !=
        LIBDEFLATE_SUCCESS)
        return EXR_ERR_CORRUPT_CHUNK;
    from_differences(z->split, size);
    join(z->split, size, decoder->unpacked_buffer);
    return EXR_ERR_SUCCESS;
}

void exr_zip_encode(struct exr_zip *zip, exr_encode_pipeline_t *encoder)
{
    encoder->encoding_user_data = zip;
    encoder->compress_fn = pack;
}

void exr_zip_decode(struct exr_zip *zip, exr_decode_pipeline_t *decoder)
{
    exr_compression_t compression;
    if (exr_get_compression(decoder->context, decoder->part_index, &compression) != EXR_ERR_SUCCESS ||
        (compression != EXR_COMPRESSION_ZIP && compression != EXR_COMPRESSION_ZIPS))
        return;
    decoder->decoding_user_data = zip;
    decoder->decompress_fn = unpack;
}
