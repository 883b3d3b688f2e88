#include "coordinator/import/image.h"

#include <limits.h>
#include <math.h>
#include <stb_image.h>
#include <string.h>

#include <openexr.h>

#include "worker/base/memory.h"

static const uint64_t free_texels = 1u << 25, texels_per_byte = 256, environment_texels_max = 1u << 26;

static bool starts(const unsigned char *bytes, size_t size, const char *magic, size_t length)
{
    return size >= length && memcmp(bytes, magic, length) == 0;
}

static bool is_png(const unsigned char *b, size_t n) { return starts(b, n, "\x89PNG\r\n\x1a\n", 8); }
static bool is_jpeg(const unsigned char *b, size_t n) { return starts(b, n, "\xff\xd8\xff", 3); }

/* stb reads on in zeros when an image ends too early and calls the result a picture. Reading through callbacks shows it. */
struct source {
    const unsigned char *bytes;
    size_t size, at;
    bool overrun; /* something was asked for that is not there */
};

enum { STB_BUFFER = 128 }; /* stb's own look-ahead: only a request of another size has to be met in full */

static int source_read(void *user, char *data, int size)
{
    struct source *source = user;
    const size_t left = source->size - source->at, count = (size_t)size < left ? (size_t)size : left;
    memcpy(data, source->bytes + source->at, count);
    source->at += count;
    source->overrun |= size > 0 && (count == 0 || (size != STB_BUFFER && count < (size_t)size));
    return (int)count;
}

static void source_skip(void *user, int count)
{
    struct source *source = user;
    if (count < 0) {
        source->at -= (size_t)-count < source->at ? (size_t)-count : source->at;
        return;
    }
    source->overrun |= (size_t)count > source->size - source->at;
    source->at = (size_t)count < source->size - source->at ? source->at + (size_t)count : source->size;
}

static int source_ended(void *user)
{
    const struct source *source = user;
    return source->at == source->size;
}

static const stbi_io_callbacks source_calls = {source_read, source_skip, source_ended};

static const char *kind_of_stranger(const unsigned char *b, size_t n)
{
    if (n >= 12 && starts(b, n, "RIFF", 4) && memcmp(b + 8, "WEBP", 4) == 0)
        return "a WebP image";
    if (starts(b, n, "\xabKTX 20\xbb", 8))
        return "a KTX2 (Basis Universal) image";
    if (starts(b, n, "DDS ", 4))
        return "a DDS image";
    return "neither PNG nor JPEG";
}

int kiln_image_append(struct kiln_builder *builder, struct kiln_image_budget *budget, const unsigned char *bytes, size_t size,
                      bool any_format, const char *where, uint64_t *first, uint32_t *width, uint32_t *height, struct kiln_error *error)
{
    int w = 0, h = 0, channels = 0;
    if (!any_format && !is_png(bytes, size) && !is_jpeg(bytes, size))
        return kiln_fail(error, KILN_BAD_INPUT, "%s is %s; convert it to PNG or JPEG", where, kind_of_stranger(bytes, size));
    if (size > INT_MAX)
        return kiln_fail(error, KILN_BAD_INPUT, "%s takes %zu bytes, more than 2 GiB; make it smaller", where, size);
    if (!stbi_info_from_memory(bytes, (int)size, &w, &h, &channels) || w <= 0 || h <= 0)
        return kiln_fail(error, KILN_BAD_INPUT, "%s cannot be read (%s); export the image again as PNG or JPEG", where, stbi_failure_reason());
    if (w > KILN_IMAGE_SIDE_MAX || h > KILN_IMAGE_SIDE_MAX)
        return kiln_fail(error, KILN_BAD_INPUT, "%s is %d x %d pixels, more than %d a side; make it smaller", where, w, h, KILN_IMAGE_SIDE_MAX);
    budget->encoded_bytes += size;
    budget->texels += (uint64_t)w * (uint64_t)h;
    if (budget->texels > free_texels + texels_per_byte * budget->encoded_bytes)
        return kiln_fail(error, KILN_BAD_INPUT, "%s, %d x %d pixels in %zu bytes, makes more texels than kiln decodes from files of this size; make it smaller",
                         where, w, h, size);
    struct source source = {bytes, size, 0, false};
    unsigned char *pixels = stbi_load_from_callbacks(&source_calls, &source, &w, &h, &channels, 4);
    if (pixels == NULL || source.overrun) {
        stbi_image_free(pixels);
        return kiln_fail(error, KILN_BAD_INPUT, "%s is a broken image (%s); export it again as PNG or JPEG", where,
                         source.overrun ? "it is cut off" : stbi_failure_reason());
    }
    size_t at = 0;
    const int status = kiln_builder_append(builder, KILN_SECTION_TEXELS, pixels, 4 * (size_t)w * (size_t)h, &at, error);
    stbi_image_free(pixels);
    *first = at;
    *width = (uint32_t)w;
    *height = (uint32_t)h;
    return status;
}

static int judge_environment(int64_t w, int64_t h, const char *where, struct kiln_error *error)
{
    if (w <= 0 || h <= 0 || w > 65536 || h > 65536 || (uint64_t)(w * h) > environment_texels_max)
        return kiln_fail(error, KILN_BAD_INPUT, "%s is %lld x %lld pixels; an environment may have up to %llu pixels", where, (long long)w,
                         (long long)h, (unsigned long long)environment_texels_max);
    return KILN_OK;
}

static int append_hdr(struct kiln_builder *builder, const unsigned char *bytes, size_t size, const char *where, uint32_t *width,
                      uint32_t *height, struct kiln_error *error)
{
    int w = 0, h = 0, channels = 0;
    if (size > INT_MAX || !stbi_info_from_memory(bytes, (int)size, &w, &h, &channels))
        return kiln_fail(error, KILN_BAD_INPUT, "%s cannot be read as a Radiance image; give an .hdr or .exr", where);
    int status = judge_environment(w, h, where, error);
    if (status != KILN_OK)
        return status;
    struct source source = {bytes, size, 0, false};
    float *pixels = stbi_loadf_from_callbacks(&source_calls, &source, &w, &h, &channels, 3);
    if (pixels == NULL || source.overrun) {
        stbi_image_free(pixels);
        return kiln_fail(error, KILN_BAD_INPUT, "%s is a broken image (%s); save it again", where,
                         source.overrun ? "it is cut off" : stbi_failure_reason());
    }
    status = kiln_builder_append(builder, KILN_SECTION_ENVIRONMENT_TEXELS, pixels, 3 * (size_t)w * (size_t)h, NULL, error);
    stbi_image_free(pixels);
    *width = (uint32_t)w;
    *height = (uint32_t)h;
    return status;
}

struct memory_stream {
    const unsigned char *bytes;
    size_t size;
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

/* The library prints its complaints on stderr unless told otherwise; ours is the sentence that counts. */
static void keep_quiet(exr_const_context_t context, exr_result_t code, const char *message)
{
    (void)context;
    (void)code;
    (void)message;
}

struct exr_target {
    float *texels; /* RGB, w x h */
    exr_attr_box2i_t window;
    int64_t width;
};

/* Points each R, G, B (or Y, which goes to all three) channel of a decoded chunk at its place among the texels. */
static bool aim_channels(exr_decode_pipeline_t *decode, float *start, int64_t width)
{
    unsigned seen = 0;
    for (int c = 0; c < decode->channel_count; c++) {
        exr_coding_channel_info_t *channel = &decode->channels[c];
        const char *name = channel->channel_name;
        const int place = strcmp(name, "R") == 0 || strcmp(name, "Y") == 0 ? 0 : strcmp(name, "G") == 0 ? 1 : strcmp(name, "B") == 0 ? 2 : -1;
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

static exr_result_t decode_chunk(exr_const_context_t context, const exr_chunk_info_t *chunk, exr_decode_pipeline_t *decode, bool first,
                                 const struct exr_target *target, int64_t x, int64_t y)
{
    exr_result_t result = first ? exr_decoding_initialize(context, 0, chunk, decode) : exr_decoding_update(context, 0, chunk, decode);
    if (result != EXR_ERR_SUCCESS)
        return result;
    if (!aim_channels(decode, target->texels + 3 * (y * target->width + x), target->width))
        return EXR_ERR_INCORRECT_CHUNK;
    if (first && (result = exr_decoding_choose_default_routines(context, 0, decode)) != EXR_ERR_SUCCESS)
        return result;
    return exr_decoding_run(context, 0, decode);
}

static exr_result_t decode_tiles(exr_const_context_t context, exr_decode_pipeline_t *decode, const struct exr_target *target)
{
    uint32_t side_x, side_y;
    exr_tile_level_mode_t level;
    exr_tile_round_mode_t round;
    exr_result_t result = exr_get_tile_descriptor(context, 0, &side_x, &side_y, &level, &round);
    const int64_t height = (int64_t)target->window.max.y - target->window.min.y + 1;
    bool first = true;
    for (int64_t y = 0; result == EXR_ERR_SUCCESS && y < height; y += side_y)
        for (int64_t x = 0; result == EXR_ERR_SUCCESS && x < target->width; x += side_x) {
            exr_chunk_info_t chunk;
            result = exr_read_tile_chunk_info(context, 0, (int)(x / side_x), (int)(y / side_y), 0, 0, &chunk);
            if (result == EXR_ERR_SUCCESS)
                result = decode_chunk(context, &chunk, decode, first, target, x, y);
            first = false;
        }
    return result;
}

static exr_result_t decode_lines(exr_const_context_t context, exr_decode_pipeline_t *decode, const struct exr_target *target)
{
    int32_t lines = 0;
    exr_result_t result = exr_get_scanlines_per_chunk(context, 0, &lines);
    if (result == EXR_ERR_SUCCESS && lines <= 0)
        result = EXR_ERR_INCORRECT_CHUNK;
    bool first = true;
    for (int64_t y = target->window.min.y; result == EXR_ERR_SUCCESS && y <= target->window.max.y; y += lines) {
        exr_chunk_info_t chunk;
        result = exr_read_scanline_chunk_info(context, 0, (int)y, &chunk);
        if (result == EXR_ERR_SUCCESS)
            result = decode_chunk(context, &chunk, decode, first, target, 0, y - target->window.min.y);
        first = false;
    }
    return result;
}

static int append_exr(struct kiln_builder *builder, const unsigned char *bytes, size_t size, const char *where, uint32_t *width,
                      uint32_t *height, struct kiln_error *error)
{
    struct memory_stream stream = {bytes, size};
    exr_context_initializer_t setup = EXR_DEFAULT_CONTEXT_INITIALIZER;
    setup.user_data = &stream;
    setup.read_fn = read_memory;
    setup.size_fn = size_of_memory;
    setup.error_handler_fn = keep_quiet;
    exr_context_t context = NULL;
    exr_decode_pipeline_t decode = EXR_DECODE_PIPELINE_INITIALIZER;
    struct exr_target target = {0};
    exr_storage_t storage;
    int status = KILN_OK;
    exr_result_t result = exr_start_read(&context, "environment", &setup);
    if (result == EXR_ERR_SUCCESS)
        result = exr_get_data_window(context, 0, &target.window);
    if (result == EXR_ERR_SUCCESS)
        result = exr_get_storage(context, 0, &storage);
    if (result != EXR_ERR_SUCCESS) {
        status = kiln_fail(error, KILN_BAD_INPUT, "%s cannot be read as OpenEXR (%s)", where, exr_get_default_error_message(result));
        goto done;
    }
    target.width = (int64_t)target.window.max.x - target.window.min.x + 1;
    const int64_t h = (int64_t)target.window.max.y - target.window.min.y + 1;
    status = judge_environment(target.width, h, where, error);
    if (status != KILN_OK)
        goto done;
    if (storage != EXR_STORAGE_SCANLINE && storage != EXR_STORAGE_TILED) {
        status = kiln_fail(error, KILN_BAD_INPUT, "%s is a deep image; save it as a flat one", where);
        goto done;
    }
    size_t first;
    status = kiln_builder_append(builder, KILN_SECTION_ENVIRONMENT_TEXELS, NULL, 3 * (size_t)(target.width * h), &first, error);
    if (status != KILN_OK)
        goto done;
    target.texels = KILN_BUILDER_DATA(builder, float, KILN_SECTION_ENVIRONMENT_TEXELS) + first;
    result = storage == EXR_STORAGE_TILED ? decode_tiles(context, &decode, &target) : decode_lines(context, &decode, &target);
    if (result != EXR_ERR_SUCCESS) {
        status = kiln_fail(error, KILN_BAD_INPUT, "%s cannot be decoded (%s); save it with channels R, G, B and ZIP compression", where,
                           exr_get_default_error_message(result));
        goto done;
    }
    if (is_grey(&decode))
        for (int64_t i = 0; i < target.width * h; i++)
            target.texels[3 * i + 1] = target.texels[3 * i + 2] = target.texels[3 * i];
    *width = (uint32_t)target.width;
    *height = (uint32_t)h;
done:
    if (context != NULL) {
        (void)exr_decoding_destroy(context, &decode);
        (void)exr_finish(&context);
    }
    return status;
}

int kiln_image_append_environment(struct kiln_builder *builder, const unsigned char *bytes, size_t size, const char *where,
                                  uint32_t *width, uint32_t *height, struct kiln_error *error)
{
    int status;
    if (starts(bytes, size, "\x76\x2f\x31\x01", 4))
        status = append_exr(builder, bytes, size, where, width, height, error);
    else if (starts(bytes, size, "#?RADIANCE", 10) || starts(bytes, size, "#?RGBE", 6))
        status = append_hdr(builder, bytes, size, where, width, height, error);
    else
        status = kiln_fail(error, KILN_BAD_INPUT, "%s is neither Radiance (.hdr) nor OpenEXR (.exr); convert it", where);
    if (status != KILN_OK)
        return status;
    float *texels = KILN_BUILDER_DATA(builder, float, KILN_SECTION_ENVIRONMENT_TEXELS);
    size_t negative = 0;
    for (size_t i = 0; i < 3 * (size_t)*width * *height; i++) {
        if (!isfinite(texels[i]))
            return kiln_fail(error, KILN_BAD_INPUT, "%s: pixel (%zu, %zu) is infinite or not a number; repair the image", where,
                             i / 3 % *width, i / 3 / *width);
        if (texels[i] < 0.0f) {
            texels[i] = 0.0f;
            negative++;
        }
    }
    if (negative > 0)
        return kiln_builder_note(builder, 1, error, "%s: %zu negative values were set to 0", where, negative);
    return KILN_OK;
}

int kiln_image_mean(struct kiln_image_budget *budget, const unsigned char *bytes, size_t size, unsigned channel, const char *where, double *mean,
                    struct kiln_error *error)
{
    struct kiln_builder *scratch = NULL;
    uint64_t first;
    uint32_t width = 0, height = 0;
    int status = kiln_builder_create(&scratch, error);
    if (status == KILN_OK)
        status = kiln_image_append(scratch, budget, bytes, size, false, where, &first, &width, &height, error);
    if (status == KILN_OK) {
        const uint8_t *texels = KILN_BUILDER_DATA(scratch, const uint8_t, KILN_SECTION_TEXELS);
        const size_t count = (size_t)width * height;
        uint64_t sum = 0;
        for (size_t i = 0; i < count; i++)
            sum += texels[4 * i + channel];
        *mean = (double)sum / (255.0 * (double)count);
    }
    kiln_builder_destroy(&scratch);
    return status;
}
