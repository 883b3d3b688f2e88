/* OpenEXR, read with OpenEXRCore: the first part of a file, R G B or Y, in scan lines or tiles.
 *
 * A header may claim millions of texels, channels and chunks. So every chunk is found and measured before texels are
 * allocated:
 * - Each has an offset and a header of its own: at least 16 bytes.
 * - Its unpacked size is at most what its packed bytes can become under the file's compression, and at most CHUNK_MAX.
 * - Together the chunks have no more bytes than the file. */
#include <math.h>
#include <openexr.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/import/image_formats.h"
#include "worker/base/memory.h"

/* Bytes that one packed byte can become, at most; 0: the library does not unpack it. RLE: 128 bytes of two. ZIP:
 * deflate. PIZ: 255 half floats of nine bits. PXR24: deflate, of three bytes for four. B44: 32 bytes of 14; B44A: of
 * 3. */
static const uint64_t reach[EXR_COMPRESSION_LAST_TYPE] = {
    [EXR_COMPRESSION_NONE] = 1,   [EXR_COMPRESSION_RLE] = 64,  [EXR_COMPRESSION_ZIPS] = 1032,
    [EXR_COMPRESSION_ZIP] = 1032, [EXR_COMPRESSION_PIZ] = 512, [EXR_COMPRESSION_PXR24] = 1376,
    [EXR_COMPRESSION_B44] = 3,    [EXR_COMPRESSION_B44A] = 11};

#define CHUNK_MAX ((uint64_t)128 << 20)
enum { CHUNK_OVERHEAD = 16 };
#define ALLOCATION_MAX ((size_t)512 << 20) /* largest single allocation by the library: a few times a chunk */

struct memory_stream {
    const unsigned char *bytes;
    size_t size;
};

struct kiln_exr {
    exr_context_t context;
    exr_decode_pipeline_t decode;
    struct memory_stream stream;
    exr_attr_box2i_t window;
    exr_storage_t storage;
    int64_t width, height;
    const char *where;
    /* state of the walk over the chunks */
    uint64_t packed;
    bool first;
    float *texels;
};

static int64_t read_memory(exr_const_context_t context, void *user, void *buffer, uint64_t size, uint64_t offset,
                           exr_stream_error_func_ptr_t report)
{
    (void)context;
    (void)report;
    const struct memory_stream *stream = user;
    if (offset >= stream->size)
        return 0;
    const uint64_t there = stream->size - offset < size ? stream->size - offset : size;
    memcpy(buffer, stream->bytes + offset, there);
    return (int64_t)there;
}

static int64_t size_of_memory(exr_const_context_t context, void *user)
{
    (void)context;
    return (int64_t)((const struct memory_stream *)user)->size;
}

/* Silences the library, which prints errors to stderr without a handler; kiln reports them itself. */
static void keep_quiet(exr_const_context_t context, exr_result_t code, const char *message)
{
    (void)context;
    (void)code;
    (void)message;
}

static void *allocate_some(size_t bytes) { return bytes > ALLOCATION_MAX ? NULL : malloc(bytes); }

int kiln_exr_open(struct kiln_exr **result, const unsigned char *bytes, size_t size, const char *where,
                  struct kiln_error *error)
{
    struct kiln_exr *exr = NULL;
    const int status = kiln_allocate(&exr, 1, sizeof *exr, "the environment's image", error);
    *result = exr;
    if (status != KILN_OK)
        return status;
    const exr_decode_pipeline_t nothing = EXR_DECODE_PIPELINE_INITIALIZER;
    exr_context_initializer_t setup = EXR_DEFAULT_CONTEXT_INITIALIZER;
    exr->decode = nothing;
    exr->where = where;
    exr->stream = (struct memory_stream){bytes, size};
    setup.user_data = &exr->stream;
    setup.read_fn = read_memory;
    setup.size_fn = size_of_memory;
    setup.error_handler_fn = keep_quiet;
    setup.alloc_fn = allocate_some;
    setup.free_fn = free;
    exr_compression_t compression = EXR_COMPRESSION_NONE;
    exr_result_t code = exr_start_read(&exr->context, "environment", &setup);
    if (code == EXR_ERR_SUCCESS)
        code = exr_get_data_window(exr->context, 0, &exr->window);
    if (code == EXR_ERR_SUCCESS)
        code = exr_get_storage(exr->context, 0, &exr->storage);
    if (code == EXR_ERR_SUCCESS)
        code = exr_get_compression(exr->context, 0, &compression);
    if (code != EXR_ERR_SUCCESS)
        return kiln_fail(error, KILN_BAD_INPUT, "%s cannot be read as OpenEXR (%s)", where,
                         exr_get_default_error_message(code));
    if (exr->storage != EXR_STORAGE_SCANLINE && exr->storage != EXR_STORAGE_TILED)
        return kiln_fail(error, KILN_BAD_INPUT, "%s is a deep image; save it as a flat one", where);
    if (compression >= EXR_COMPRESSION_LAST_TYPE || reach[compression] == 0)
        return kiln_fail(
            error, KILN_BAD_INPUT,
            "%s has a compression that kiln does not read (DWA, or an unknown one); save it with ZIP compression",
            where);
    exr->width = (int64_t)exr->window.max.x - exr->window.min.x + 1;
    exr->height = (int64_t)exr->window.max.y - exr->window.min.y + 1;
    return KILN_OK;
}

bool kiln_exr_other_primaries(const struct kiln_exr *exr)
{
    exr_attr_chromaticities_t c;
    if (exr_attr_get_chromaticities(exr->context, 0, "chromaticities", &c) != EXR_ERR_SUCCESS)
        return false;
    const double primaries[8] = {(double)c.red_x,  (double)c.red_y,  (double)c.green_x, (double)c.green_y,
                                 (double)c.blue_x, (double)c.blue_y, (double)c.white_x, (double)c.white_y};
    return !kiln_primaries_are_srgb(primaries);
}

void kiln_exr_size(const struct kiln_exr *exr, int64_t *width, int64_t *height)
{
    *width = exr->width;
    *height = exr->height;
}

void kiln_exr_close(struct kiln_exr **pointer)
{
    struct kiln_exr *exr = *pointer;
    if (exr != NULL && exr->context != NULL) {
        (void)exr_decoding_destroy(exr->context, &exr->decode);
        (void)exr_finish(&exr->context);
    }
    kiln_free(pointer);
}

/* ---- all chunks, in order ---- */

/* Function called for each chunk; (x, y): the chunk's upper left texel in the image. */
typedef exr_result_t visit(struct kiln_exr *exr, const exr_chunk_info_t *chunk, int64_t x, int64_t y);

static exr_result_t visit_tiles(struct kiln_exr *exr, visit *act)
{
    uint32_t side_x, side_y;
    exr_tile_level_mode_t level;
    exr_tile_round_mode_t round;
    exr_result_t result = exr_get_tile_descriptor(exr->context, 0, &side_x, &side_y, &level, &round);
    if (result == EXR_ERR_SUCCESS && (side_x == 0 || side_y == 0))
        result = EXR_ERR_INCORRECT_CHUNK;
    for (int64_t y = 0; result == EXR_ERR_SUCCESS && y < exr->height; y += side_y)
        for (int64_t x = 0; result == EXR_ERR_SUCCESS && x < exr->width; x += side_x) {
            exr_chunk_info_t chunk;
            result = exr_read_tile_chunk_info(exr->context, 0, (int)(x / side_x), (int)(y / side_y), 0, 0, &chunk);
            if (result == EXR_ERR_SUCCESS)
                result = act(exr, &chunk, x, y);
        }
    return result;
}

static exr_result_t visit_lines(struct kiln_exr *exr, visit *act)
{
    int32_t lines = 0;
    exr_result_t result = exr_get_scanlines_per_chunk(exr->context, 0, &lines);
    if (result == EXR_ERR_SUCCESS && lines <= 0)
        result = EXR_ERR_INCORRECT_CHUNK;
    for (int64_t y = 0; result == EXR_ERR_SUCCESS && y < exr->height; y += lines) {
        exr_chunk_info_t chunk;
        result = exr_read_scanline_chunk_info(exr->context, 0, (int)(exr->window.min.y + y), &chunk);
        if (result == EXR_ERR_SUCCESS)
            result = act(exr, &chunk, 0, y);
    }
    return result;
}

static exr_result_t visit_chunks(struct kiln_exr *exr, visit *act)
{
    return exr->storage == EXR_STORAGE_TILED ? visit_tiles(exr, act) : visit_lines(exr, act);
}

/* ---- measuring ---- */

static exr_result_t measure_chunk(struct kiln_exr *exr, const exr_chunk_info_t *chunk, int64_t x, int64_t y)
{
    (void)x;
    (void)y;
    exr->packed += chunk->packed_size;
    if (chunk->compression >= EXR_COMPRESSION_LAST_TYPE || reach[chunk->compression] == 0 ||
        exr->packed > exr->stream.size || chunk->unpacked_size > CHUNK_MAX ||
        (chunk->unpacked_size != chunk->packed_size &&
         chunk->unpacked_size / reach[chunk->compression] > chunk->packed_size))
        return EXR_ERR_BAD_CHUNK_LEADER;
    return EXR_ERR_SUCCESS;
}

static exr_result_t measure_chunks(struct kiln_exr *exr)
{
    int32_t count = 0;
    const exr_result_t result = exr_get_chunk_count(exr->context, 0, &count);
    if (result != EXR_ERR_SUCCESS)
        return result;
    if (count <= 0 || (uint64_t)count > exr->stream.size / CHUNK_OVERHEAD)
        return EXR_ERR_BAD_CHUNK_LEADER;
    return visit_chunks(exr, measure_chunk);
}

/* ---- decoding ---- */

/* Points the channels R, G, B of a decoded chunk (or Y, for all three) to their places among the texels. */
static bool aim_channels(exr_decode_pipeline_t *decode, float *start, int64_t width)
{
    unsigned seen = 0;
    for (int c = 0; c < decode->channel_count; c++) {
        exr_coding_channel_info_t *channel = &decode->channels[c];
        const char *name = channel->channel_name;
        const int place = strcmp(name, "R") == 0 || strcmp(name, "Y") == 0 ? 0
                          : strcmp(name, "G") == 0                         ? 1
                          : strcmp(name, "B") == 0                         ? 2
                                                                           : -1;
        if (place < 0 || channel->x_samples != 1 || channel->y_samples != 1) {
            channel->decode_to_ptr = NULL;
            continue;
        }
        seen |= strcmp(name, "Y") == 0 ? 8u : 1u << place;
        channel->decode_to_ptr = (uint8_t *)(start + place);
        channel->user_pixel_stride = 3 * sizeof(float);
        channel->user_line_stride = (int32_t)(3 * width * (int64_t)sizeof(float));
        channel->user_bytes_per_element = sizeof(float);
        channel->user_data_type = EXR_PIXEL_FLOAT;
    }
    return seen == 7u || seen == 8u || seen == 9u;
}

static bool is_grey(const exr_decode_pipeline_t *decode)
{
    for (int c = 0; c < decode->channel_count; c++)
        if (strcmp(decode->channels[c].channel_name, "G") == 0)
            return false;
    return true;
}

static exr_result_t decode_chunk(struct kiln_exr *exr, const exr_chunk_info_t *chunk, int64_t x, int64_t y)
{
    exr_decode_pipeline_t *decode = &exr->decode;
    const bool first = exr->first;
    exr_result_t result = first ? exr_decoding_initialize(exr->context, 0, chunk, decode)
                                : exr_decoding_update(exr->context, 0, chunk, decode);
    exr->first = false;
    if (result != EXR_ERR_SUCCESS)
        return result;
    if (!aim_channels(decode, exr->texels + 3 * (y * exr->width + x), exr->width))
        return EXR_ERR_INCORRECT_CHUNK;
    if (first && (result = exr_decoding_choose_default_routines(exr->context, 0, decode)) != EXR_ERR_SUCCESS)
        return result;
    return exr_decoding_run(exr->context, 0, decode);
}

int kiln_exr_decode(struct kiln_exr *exr, float *rgb, struct kiln_error *error)
{
    exr->packed = 0;
    exr->first = true;
    exr->texels = rgb;
    const exr_result_t result = rgb == NULL ? measure_chunks(exr) : visit_chunks(exr, decode_chunk);
    if (result != EXR_ERR_SUCCESS)
        return kiln_fail(error, KILN_BAD_INPUT,
                         "%s cannot be decoded (%s); save it with channels R, G, B and ZIP compression", exr->where,
                         result == EXR_ERR_BAD_CHUNK_LEADER ? "its header claims more than its bytes can hold"
                                                            : exr_get_default_error_message(result));
    for (int64_t i = 0; rgb != NULL && is_grey(&exr->decode) && i < exr->width * exr->height; i++)
        rgb[3 * i + 1] = rgb[3 * i + 2] = rgb[3 * i];
    return KILN_OK;
}
