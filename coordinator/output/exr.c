#include "coordinator/output/exr_private.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <omp.h>
#include <stdatomic.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "coordinator/files/plain_file.h"
#include "coordinator/files/publish.h"
#include "worker/base/calls.h"
#include "worker/base/memory.h"

void exr_stay_silent(exr_const_context_t context, exr_result_t code, const char *message)
{
    (void)context;
    (void)code;
    (void)message;
}

int exr_failed(int status, const char *path, const char *act, exr_result_t code, struct kiln_error *error)
{
    return kiln_fail(error, code == EXR_ERR_OUT_OF_MEMORY ? KILN_SYSTEM : status, "'%s' cannot be %s as OpenEXR: %s",
                     path, act, exr_get_default_error_message(code));
}

/* ---- write ---- */

int64_t exr_write_stream(exr_const_context_t context, void *user, const void *buffer, uint64_t size, uint64_t offset,
                         exr_stream_error_func_ptr_t report)
{
    struct exr_output_stream *stream = user;
    (void)context;
    (void)report;
    if (stream->status == KILN_OK)
        stream->status = kiln_write_all(stream->descriptor, buffer, size, offset, stream->path, stream->error);
    return stream->status == KILN_OK ? (int64_t)size : -1;
}

/* Collects the library's many small writes, each of one attribute or number, before an output stream. */
struct write_buffer {
    struct exr_output_stream *stream;
    char *bytes;
    size_t size;     /* bytes that are held */
    uint64_t offset; /* their place in the file */
};

enum { BUFFER_SIZE = 1 << 16 };

static int64_t flush(struct write_buffer *b)
{
    const int64_t written =
        b->size > 0 ? exr_write_stream(NULL, b->stream, b->bytes, b->size, b->offset, NULL) : (int64_t)b->size;
    b->offset += b->size;
    b->size = 0;
    return written;
}

static int64_t write_buffered(exr_const_context_t context, void *user, const void *buffer, uint64_t size,
                              uint64_t offset, exr_stream_error_func_ptr_t report)
{
    struct write_buffer *b = user;
    if ((offset != b->offset + b->size || size > BUFFER_SIZE - b->size) && flush(b) < 0)
        return -1;
    if (size > BUFFER_SIZE)
        return exr_write_stream(context, b->stream, buffer, size, offset, report);
    if (b->size == 0)
        b->offset = offset;
    memcpy(b->bytes + b->size, buffer, size);
    b->size += size;
    return (int64_t)size;
}

exr_result_t exr_declare(exr_context_t file, const struct kiln_image *image,
                         const struct kiln_exr_attribute *attributes, size_t attribute_count)
{
    int part = 0;
    exr_result_t code = exr_add_part(file, NULL, EXR_STORAGE_SCANLINE, &part);
    if (code == EXR_ERR_SUCCESS)
        code = exr_initialize_required_attr_simple(file, part, (int32_t)image->width, (int32_t)image->height,
                                                   EXR_COMPRESSION_ZIP);
    for (size_t i = 0; code == EXR_ERR_SUCCESS && i < image->channel_count; i++)
        code = exr_add_channel(file, part, image->channels[i].name,
                               image->channels[i].half ? EXR_PIXEL_HALF : EXR_PIXEL_FLOAT, EXR_PERCEPTUALLY_LOGARITHMIC,
                               1, 1);
    for (size_t i = 0; code == EXR_ERR_SUCCESS && i < attribute_count; i++) {
        const struct kiln_exr_attribute *a = &attributes[i];
        if (a->kind == KILN_EXR_STRING)
            code = exr_attr_set_string(file, part, a->name, a->text);
        else if (a->kind == KILN_EXR_INTEGER)
            code = exr_attr_set_int(file, part, a->name, a->integer);
        else
            code = exr_attr_set_float(file, part, a->name, a->number);
    }
    return code == EXR_ERR_SUCCESS ? exr_write_header(file) : code;
}

static exr_result_t fill_encoder(exr_encode_pipeline_t *encoder, const struct kiln_image *image, uint32_t y)
{
    if ((size_t)encoder->channel_count != image->channel_count)
        return EXR_ERR_INVALID_ARGUMENT;
    for (size_t c = 0; c < image->channel_count; c++) {
        exr_coding_channel_info_t *info = &encoder->channels[c];
        const struct kiln_image_channel *channel = kiln_image_find(image, info->channel_name);
        if (channel == NULL)
            return EXR_ERR_INVALID_ARGUMENT;
        info->user_bytes_per_element = (int16_t)sizeof(float);
        info->user_data_type = EXR_PIXEL_FLOAT;
        info->user_pixel_stride = (int32_t)sizeof(float);
        info->user_line_stride = (int32_t)(sizeof(float) * image->width);
        info->encode_from_ptr = (const uint8_t *)(channel->values + (size_t)y * image->width);
    }
    return EXR_ERR_SUCCESS;
}

exr_result_t exr_pack_chunk(struct exr_packer *p, exr_context_t file, const struct kiln_image *image, uint32_t y)
{
    exr_chunk_info_t chunk;
    if (p->zip == NULL && (p->zip = exr_zip_create()) == NULL)
        return EXR_ERR_OUT_OF_MEMORY;
    exr_result_t code = exr_write_scanline_chunk_info(file, 0, (int)y, &chunk);
    if (code == EXR_ERR_SUCCESS)
        code = p->started ? exr_encoding_update(file, 0, &chunk, &p->encoder)
                          : exr_encoding_initialize(file, 0, &chunk, &p->encoder);
    if (code == EXR_ERR_SUCCESS)
        code = fill_encoder(&p->encoder, image, y);
    if (code == EXR_ERR_SUCCESS && !p->started) {
        code = exr_encoding_choose_default_routines(file, 0, &p->encoder);
        p->write = p->encoder.write_fn;
        p->encoder.write_fn = NULL;
        p->encoder.yield_until_ready_fn = NULL; /* this function would refuse a chunk before its turn */
        exr_zip_encode(p->zip, &p->encoder);
        p->started = true;
    }
    return code == EXR_ERR_SUCCESS ? exr_encoding_run(file, 0, &p->encoder) : code;
}

exr_result_t exr_packer_end(struct exr_packer *p, exr_const_context_t file)
{
    const exr_result_t code = exr_encoding_destroy(file, &p->encoder);
    exr_zip_destroy(&p->zip);
    return code;
}

/* Compresses `count` chunks from row y on, one with each packer, and writes them in order, as the library requires. */
static exr_result_t write_some(struct exr_packer *packers, uint32_t count, exr_context_t file,
                               const struct kiln_image *image, uint32_t y, uint32_t step, int32_t *written)
{
#pragma omp parallel for schedule(dynamic, 1) if (count > 1)
    for (uint32_t i = 0; i < count; i++)
        packers[i].code = exr_pack_chunk(&packers[i], file, image, y + i * step);
    for (uint32_t i = 0; i < count; i++) {
        const exr_result_t code =
            packers[i].code == EXR_ERR_SUCCESS ? packers[i].write(&packers[i].encoder) : packers[i].code;
        if (code != EXR_ERR_SUCCESS)
            return code;
        (*written)++;
    }
    return EXR_ERR_SUCCESS;
}

/* Writes all chunks, and counts them, since exr_finish succeeds even for an incomplete file. */
static exr_result_t write_chunks(exr_context_t file, const struct kiln_image *image, int32_t *written)
{
    int32_t lines = 1;
    exr_result_t code = exr_get_scanlines_per_chunk(file, 0, &lines);
    const uint32_t step = (uint32_t)lines, chunks = (image->height + step - 1) / step,
                   wanted = 4 * (uint32_t)omp_get_max_threads();
    const uint32_t count = chunks < wanted ? chunks : wanted;
    struct exr_packer *packers = NULL;
    if (kiln_allocate(&packers, count, sizeof *packers, "chunks", NULL) != KILN_OK)
        return EXR_ERR_OUT_OF_MEMORY;
    for (uint32_t i = 0; i < count; i++)
        packers[i] = EXR_PACKER;
    for (uint32_t c = 0; code == EXR_ERR_SUCCESS && c < chunks; c += count)
        code = write_some(packers, chunks - c < count ? chunks - c : count, file, image, c * step, step, written);
    for (uint32_t i = 0; i < count; i++) {
        const exr_result_t closed = exr_packer_end(&packers[i], file);
        code = code == EXR_ERR_SUCCESS ? closed : code;
    }
    kiln_free(&packers);
    return code;
}

static int write_through(struct write_buffer *buffer, const struct kiln_image *image,
                         const struct kiln_exr_attribute *attributes, size_t attribute_count)
{
    struct exr_output_stream *stream = buffer->stream;
    exr_context_initializer_t setup = EXR_DEFAULT_CONTEXT_INITIALIZER;
    setup.error_handler_fn = exr_stay_silent;
    setup.user_data = buffer;
    setup.write_fn = write_buffered;
    exr_context_t file = NULL;
    int32_t written = 0, expected = 0;
    exr_result_t code = exr_start_write(&file, stream->path, EXR_WRITE_FILE_DIRECTLY, &setup);
    if (code != EXR_ERR_SUCCESS)
        return exr_failed(KILN_CANNOT_CREATE, stream->path, "started", code, stream->error);
    code = exr_declare(file, image, attributes, attribute_count);
    if (code == EXR_ERR_SUCCESS)
        code = exr_get_chunk_count(file, 0, &expected);
    if (code == EXR_ERR_SUCCESS)
        code = write_chunks(file, image, &written);
    const exr_result_t finished = exr_finish(&file);
    if (code == EXR_ERR_SUCCESS)
        code = finished;
    if (stream->status == KILN_OK)
        (void)flush(buffer); /* sets stream->status */
    if (stream->status != KILN_OK)
        return stream->status;
    if (code != EXR_ERR_SUCCESS)
        return exr_failed(KILN_IO, stream->path, "written", code, stream->error);
    if (written != expected)
        return kiln_fail(stream->error, KILN_BUG, "'%s': %d of %d chunks were written", stream->path, (int)written,
                         (int)expected);
    return KILN_OK;
}

static int write_file(struct exr_output_stream *stream, const struct kiln_image *image,
                      const struct kiln_exr_attribute *attributes, size_t attribute_count)
{
    struct write_buffer buffer = {.stream = stream};
    int status = kiln_allocate(&buffer.bytes, BUFFER_SIZE, 1, "a file's bytes", stream->error);
    if (status == KILN_OK)
        status = write_through(&buffer, image, attributes, attribute_count);
    kiln_free(&buffer.bytes);
    return status;
}

static bool same_value(float expected, float found, bool half)
{
    if (isnan(expected))
        return isnan(found);
    if (!half)
        return memcmp(&expected, &found, sizeof found) == 0;
    return fabsf(expected - found) <= fabsf(expected) * 0x1p-11f + 0x1p-25f || expected == found;
}

size_t exr_count_same(const struct kiln_image_channel *mine, const struct kiln_image_channel *theirs, size_t count)
{
    size_t same = count;
#pragma omp parallel for schedule(static) reduction(min : same) if (count > KILN_IMAGE_ALONE)
    for (size_t i = 0; i < count; i++)
        if (!same_value(mine->values[i], theirs->values[i], mine->half) && i < same)
            same = i;
    return same;
}

static int read_back(const struct kiln_publish *place, const struct kiln_image *image, struct kiln_error *error)
{
    struct kiln_image *found = NULL;
    struct kiln_error own = {""};
    const char *path = place->temporary;
    int status = kiln_exr_read(place->opens, NULL, 0, &found, &own);
    if (status != KILN_OK) /* the file was just written by this process, so bad content is an I/O error */
        return kiln_fail(error, status == KILN_BAD_INPUT ? KILN_IO : status,
                         "'%s' does not read back as it was written: %s", path, own.message);
    if (found->width != image->width || found->height != image->height || found->channel_count != image->channel_count)
        status = kiln_fail(error, KILN_IO, "'%s' does not read back as it was written: size or channels differ", path);
    const size_t pixels = (size_t)image->width * image->height;
    for (size_t c = 0; status == KILN_OK && c < image->channel_count; c++) {
        const struct kiln_image_channel *mine = &image->channels[c], *theirs = &found->channels[c];
        const size_t same = strcmp(mine->name, theirs->name) == 0 ? exr_count_same(mine, theirs, pixels) : 0;
        if (same < pixels)
            status = kiln_fail(error, KILN_IO, "'%s' does not read back as it was written: channel %s, pixel %zu", path,
                               mine->name, same);
    }
    kiln_image_destroy(&found);
    return status;
}

static int check_halves(const char *path, const struct kiln_image *image, struct kiln_error *error)
{
    const size_t pixels = (size_t)image->width * image->height;
    for (size_t c = 0; c < image->channel_count; c++)
        for (size_t i = 0; image->channels[c].half && i < pixels; i++)
            if (fabsf(image->channels[c].values[i]) > KILN_HALF_MAX)
                return kiln_fail(error, KILN_BUG, "'%s': %g in channel %s does not fit half precision", path,
                                 (double)image->channels[c].values[i], image->channels[c].name);
    return KILN_OK;
}

int exr_check_image(const char *path, const struct kiln_image *image, struct kiln_error *error)
{
    if (image->width == 0 || image->height == 0 || image->width > INT32_MAX / sizeof(float) ||
        image->height > INT32_MAX)
        return kiln_fail(error, KILN_CANNOT_CREATE, "'%s': %u x %u pixels is not a size that OpenEXR holds", path,
                         image->width, image->height);
    return check_halves(path, image, error);
}

int kiln_exr_put(struct kiln_publish_batch *batch, const char *directory, const char *name,
                 const struct kiln_image *image, const struct kiln_exr_attribute *attributes, size_t attribute_count,
                 struct kiln_error *error)
{
    struct kiln_publish place;
    int status = exr_check_image(name, image, error);
    if (status == KILN_OK)
        status = kiln_publish_begin(&place, directory, name, error);
    if (status != KILN_OK)
        return status;
    struct exr_output_stream stream = {.path = place.temporary, .error = error};
    if ((status = kiln_publish_open(&place, &stream.descriptor, error)) != KILN_OK) {
        kiln_publish_close(&place);
        return status;
    }
    status = write_file(&stream, image, attributes, attribute_count);
    if (kiln_close(stream.descriptor) != 0 && status == KILN_OK)
        status = kiln_fail_errno(error, KILN_IO, "'%s' cannot be closed", place.temporary);
    if (status == KILN_OK)
        status = read_back(&place, image, error);
    if (status == KILN_OK)
        return batch != NULL ? kiln_publish_put(batch, &place, error) : kiln_publish_finish(&place, error);
    kiln_publish_abandon(&place);
    return status;
}

int kiln_exr_write_below(const char *directory, const char *name, const struct kiln_image *image,
                         const struct kiln_exr_attribute *attributes, size_t attribute_count, struct kiln_error *error)
{
    return kiln_exr_put(NULL, directory, name, image, attributes, attribute_count, error);
}

int kiln_exr_write(const char *path, const struct kiln_image *image, const struct kiln_exr_attribute *attributes,
                   size_t attribute_count, struct kiln_error *error)
{
    return kiln_exr_write_below(NULL, path, image, attributes, attribute_count, error);
}

/* ---- read ---- */

static bool is_wanted(const char *name, const char *const *wanted, size_t count)
{
    for (size_t i = 0; i < count; i++)
        if (strcmp(name, wanted[i]) == 0)
            return true;
    return wanted == NULL;
}

/* Input stream of the library: a descriptor. */
struct input_stream {
    int descriptor;
    const char *path; /* for messages */
    int64_t bytes;
    atomic_int number; /* errno of a failed read, whose chunk the library would report as damaged; 0: none */
};

static int64_t input_size(exr_const_context_t context, void *user)
{
    (void)context;
    return ((const struct input_stream *)user)->bytes;
}

/* Reads up to `size` bytes, since the library sometimes asks for more than the file has. */
static int64_t read_stream(exr_const_context_t context, void *user, void *buffer, uint64_t size, uint64_t offset,
                           exr_stream_error_func_ptr_t report)
{
    struct input_stream *stream = user;
    uint64_t done = 0;
    (void)context;
    (void)report;
    if (offset > INT64_MAX || size > INT64_MAX - offset)
        return -1;
    while (done < size) {
        const ssize_t got = pread(stream->descriptor, (char *)buffer + done, size - done, (off_t)(offset + done));
        if (got < 0 && errno == EINTR)
            continue;
        if (got < 0) {
            stream->number = errno;
            return -1;
        }
        if (got == 0)
            break;
        done += (uint64_t)got;
    }
    return (int64_t)done;
}

enum { HEADER_MOST = 1 << 20, ATTRIBUTES_MOST = 256, CHANNELS_BYTES_MOST = 1 << 15 };

static uint32_t little_endian(const uint8_t *bytes)
{
    return (uint32_t)bytes[0] | (uint32_t)bytes[1] << 8 | (uint32_t)bytes[2] << 16 | (uint32_t)bytes[3] << 24;
}

/* Whether the attributes end within the bytes, are not too many, and the list of channels is not too long, since the
 * time of the library grows with the square of its length. An attribute consists of a name and a type, each with a zero
 * byte, a size of four bytes, and so many bytes. */
static bool attributes_are_sane(const uint8_t *bytes, size_t size)
{
    size_t at = 8;
    for (int count = 0; count <= ATTRIBUTES_MOST && at < size; count++) {
        const size_t name = strnlen((const char *)bytes + at, size - at);
        if (name == 0)
            return true; /* end of the header */
        const size_t type_at = at + name + 1 < size ? at + name + 1 : size,
                     type = strnlen((const char *)bytes + type_at, size - type_at);
        const size_t value_at = type_at + type + 1 + 4;
        if (value_at > size)
            return false;
        const uint32_t value = little_endian(bytes + value_at - 4);
        if (value > size - value_at ||
            (value > CHANNELS_BYTES_MOST && strcmp((const char *)bytes + type_at, "chlist") == 0))
            return false;
        at = value_at + value;
    }
    return false;
}

/* Checks the header before the library reads it: one part of scanlines, with a reasonable number of attributes. */
static int check_header(struct input_stream *stream, struct kiln_error *error)
{
    enum { SCANLINES = 2, LONG_NAMES = 0x400 };
    static const uint8_t magic[4] = {0x76, 0x2f, 0x31, 0x01};
    const size_t size = stream->bytes < HEADER_MOST ? (size_t)stream->bytes : HEADER_MOST;
    uint8_t *bytes = NULL;
    int status = kiln_allocate(&bytes, size, 1, "a header of OpenEXR", error);
    if (status != KILN_OK)
        return status;
    if (read_stream(NULL, stream, bytes, size, 0, NULL) != (int64_t)size || size < 8 ||
        memcmp(bytes, magic, sizeof magic) != 0)
        status = kiln_fail(error, KILN_BAD_INPUT,
                           "'%s' cannot be read as OpenEXR: its first bytes are not those of one", stream->path);
    else if ((little_endian(bytes + 4) & ~(uint32_t)LONG_NAMES) != SCANLINES)
        status = kiln_fail(
            error, KILN_BAD_INPUT,
            "'%s' is an OpenEXR file in tiles, of several parts or deep: only plain ones of scanlines are read here",
            stream->path);
    else if (!attributes_are_sane(bytes, size))
        status = kiln_fail(
            error, KILN_BAD_INPUT,
            "'%s' cannot be read as OpenEXR: its header is damaged, longer than 1 MiB, or lists hundreds of channels",
            stream->path);
    kiln_free(&bytes);
    return status;
}

/* Checks the image size against the file size: deflate compresses at most about 1030 : 1. */
static int check_size(const struct input_stream *stream, uint64_t width, uint64_t height, uint64_t bytes_per_pixel,
                      struct kiln_error *error)
{
    const uint64_t possible = (uint64_t)stream->bytes * 1100u + 4096u;
    if (width == 0 || height == 0 || width > possible / height || bytes_per_pixel > possible / (width * height))
        return kiln_fail(error, KILN_BAD_INPUT,
                         "'%s' claims %llu x %llu pixels, more than its %lld bytes can hold: it is damaged",
                         stream->path, (unsigned long long)width, (unsigned long long)height, (long long)stream->bytes);
    return KILN_OK;
}

static int list_channels(exr_const_context_t file, const char *path, const char *const *wanted, size_t wanted_count,
                         const char ***names, size_t *count, uint64_t *bytes_per_pixel, struct kiln_error *error)
{
    const exr_attr_chlist_t *list = NULL;
    const exr_result_t code = exr_get_channels(file, 0, &list);
    if (code != EXR_ERR_SUCCESS)
        return exr_failed(KILN_BAD_INPUT, path, "read", code, error);
    const int status = kiln_allocate(names, (size_t)list->num_channels, sizeof **names, "channel names", error);
    if (status != KILN_OK)
        return status;
    for (int i = 0; i < list->num_channels; i++) {
        const exr_attr_chlist_entry_t *entry = &list->entries[i];
        *bytes_per_pixel += entry->pixel_type == EXR_PIXEL_HALF ? 2 : 4;
        if (entry->pixel_type == EXR_PIXEL_UINT || !is_wanted(entry->name.str, wanted, wanted_count))
            continue;
        if (entry->x_sampling != 1 || entry->y_sampling != 1)
            return kiln_fail(error, KILN_BAD_INPUT, "'%s': channel %s is subsampled, which is not read here", path,
                             entry->name.str);
        (*names)[(*count)++] = entry->name.str;
    }
    return KILN_OK;
}

static void note_halves(exr_const_context_t file, const struct kiln_image *image)
{
    const exr_attr_chlist_t *list = NULL;
    if (exr_get_channels(file, 0, &list) != EXR_ERR_SUCCESS)
        return;
    for (int i = 0; i < list->num_channels; i++) {
        struct kiln_image_channel *channel = kiln_image_find(image, list->entries[i].name.str);
        if (channel != NULL)
            channel->half = list->entries[i].pixel_type == EXR_PIXEL_HALF;
    }
}

static void fill_decoder(exr_decode_pipeline_t *decoder, const struct kiln_image *image, uint32_t y)
{
    for (int16_t c = 0; c < decoder->channel_count; c++) {
        exr_coding_channel_info_t *info = &decoder->channels[c];
        struct kiln_image_channel *channel = kiln_image_find(image, info->channel_name);
        if (channel == NULL) {
            info->decode_to_ptr = NULL;
            continue;
        }
        info->user_bytes_per_element = (int16_t)sizeof(float);
        info->user_data_type = EXR_PIXEL_FLOAT;
        info->user_pixel_stride = (int32_t)sizeof(float);
        info->user_line_stride = (int32_t)(sizeof(float) * image->width);
        info->decode_to_ptr = (uint8_t *)(channel->values + (size_t)y * image->width);
    }
}

/* Decompresses one chunk at a time; initialise with UNPACKER. */
struct unpacker {
    exr_decode_pipeline_t decoder;
    struct exr_zip *zip;
    bool started;
};
#define UNPACKER ((struct unpacker){.decoder = EXR_DECODE_PIPELINE_INITIALIZER})

static exr_result_t read_chunk(struct unpacker *u, exr_const_context_t file, int32_t top,
                               const struct kiln_image *image, uint32_t y)
{
    exr_chunk_info_t chunk;
    exr_decode_pipeline_t *decoder = &u->decoder;
    if (u->zip == NULL && (u->zip = exr_zip_create()) == NULL)
        return EXR_ERR_OUT_OF_MEMORY;
    exr_result_t code = exr_read_scanline_chunk_info(file, 0, top + (int)y, &chunk);
    if (code == EXR_ERR_SUCCESS)
        code = u->started ? exr_decoding_update(file, 0, &chunk, decoder)
                          : exr_decoding_initialize(file, 0, &chunk, decoder);
    if (code == EXR_ERR_SUCCESS)
        fill_decoder(decoder, image, y);
    if (code == EXR_ERR_SUCCESS && !u->started) {
        code = exr_decoding_choose_default_routines(file, 0, decoder);
        exr_zip_decode(u->zip, decoder);
        u->started = true;
    }
    return code == EXR_ERR_SUCCESS ? exr_decoding_run(file, 0, decoder) : code;
}

/* Reads all chunks. If several fail, the result is that of the first, so that it does not depend on threads. */
exr_result_t exr_read_chunks(exr_const_context_t file, int32_t top, const struct kiln_image *image)
{
    int32_t lines = 1;
    exr_result_t failure = exr_get_scanlines_per_chunk(file, 0, &lines);
    if (failure == EXR_ERR_SUCCESS && lines < 1) /* the library does not know the compression */
        failure = EXR_ERR_INVALID_ATTR;
    const uint32_t step = (uint32_t)lines, chunks = failure != EXR_ERR_SUCCESS ? 0 : (image->height + step - 1) / step;
    uint32_t failed = chunks;
#pragma omp parallel if (chunks > 1)
    {
        struct unpacker unpacker = UNPACKER;
#pragma omp for schedule(dynamic, 1)
        for (uint32_t c = 0; c < chunks; c++) {
            const exr_result_t code = read_chunk(&unpacker, file, top, image, c * step);
            if (code == EXR_ERR_SUCCESS)
                continue;
#pragma omp critical(kiln_read_chunks)
            if (c < failed) {
                failed = c;
                failure = code;
            }
        }
        (void)exr_decoding_destroy(file, &unpacker.decoder);
        exr_zip_destroy(&unpacker.zip);
    }
    return failure;
}

static int read_part(exr_const_context_t file, const struct input_stream *stream, const char *const *wanted,
                     size_t wanted_count, struct kiln_image **image, struct kiln_error *error)
{
    const char *path = stream->path;
    exr_storage_t storage;
    exr_attr_box2i_t window;
    exr_result_t code = exr_get_storage(file, 0, &storage);
    if (code == EXR_ERR_SUCCESS)
        code = exr_get_data_window(file, 0, &window);
    if (code != EXR_ERR_SUCCESS)
        return exr_failed(KILN_BAD_INPUT, path, "read", code, error);
    if (storage != EXR_STORAGE_SCANLINE)
        return kiln_fail(error, KILN_BAD_INPUT,
                         "'%s' is a tiled or deep OpenEXR file: only scanline files are read here", path);
    const char **names = NULL;
    size_t count = 0;
    uint64_t bytes_per_pixel = 0;
    const int64_t width = (int64_t)window.max.x - window.min.x + 1, height = (int64_t)window.max.y - window.min.y + 1;
    int status = width > INT32_MAX / 4 || width < 1 || height < 1
                     ? kiln_fail(error, KILN_BAD_INPUT, "'%s' has a data window without pixels or too wide", path)
                     : list_channels(file, path, wanted, wanted_count, &names, &count, &bytes_per_pixel, error);
    if (status == KILN_OK)
        status = check_size(stream, (uint64_t)width, (uint64_t)height, bytes_per_pixel, error);
    if (status == KILN_OK)
        status = kiln_image_create(image, (uint32_t)width, (uint32_t)height, names, count, error);
    if (status == KILN_OK)
        note_halves(file, *image);
    if (status == KILN_OK && (code = exr_read_chunks(file, window.min.y, *image)) != EXR_ERR_SUCCESS) {
        status = exr_failed(KILN_BAD_INPUT, path, "read", code, error);
        kiln_image_destroy(image);
    }
    kiln_free(&names);
    return status;
}

static int read_stream_image(struct input_stream *stream, const char *const *wanted, size_t wanted_count,
                             struct kiln_image **image, struct kiln_error *error)
{
    int status = check_header(stream, error);
    if (status != KILN_OK)
        return status;
    exr_context_initializer_t setup = EXR_DEFAULT_CONTEXT_INITIALIZER;
    setup.error_handler_fn = exr_stay_silent;
    setup.user_data = stream;
    setup.read_fn = read_stream;
    setup.size_fn = input_size;
    setup.flags = EXR_CONTEXT_FLAG_DISABLE_CHUNK_RECONSTRUCTION;
    exr_context_t file = NULL;
    const exr_result_t code = exr_start_read(&file, stream->path, &setup);
    if (code != EXR_ERR_SUCCESS)
        return exr_failed(KILN_BAD_INPUT, stream->path, "read", code, error);
    status = read_part(file, stream, wanted, wanted_count, image, error);
    (void)exr_finish(&file);
    return status;
}

int kiln_exr_read_open(int descriptor, const char *path, const char *const *wanted, size_t wanted_count,
                       struct kiln_image **image, struct kiln_error *error)
{
    struct stat found;
    *image = NULL;
    if (fstat(descriptor, &found) != 0 || !S_ISREG(found.st_mode))
        return kiln_fail(error, KILN_BAD_INPUT, "'%s' is not a plain file", path);
    struct input_stream stream = {.descriptor = descriptor, .path = path, .bytes = (int64_t)found.st_size};
    const int status = read_stream_image(&stream, wanted, wanted_count, image, error);
    if (status == KILN_OK || stream.number == 0)
        return status;
    errno = stream.number; /* the file itself may be sound */
    return kiln_fail_errno(error, KILN_IO, "'%s' cannot be read", path);
}

int kiln_exr_read(const char *path, const char *const *wanted, size_t wanted_count, struct kiln_image **image,
                  struct kiln_error *error)
{
    int descriptor;
    *image = NULL;
    int status = kiln_open_plain(path, &descriptor, error);
    if (status != KILN_OK)
        return status;
    status = kiln_exr_read_open(descriptor, path, wanted, wanted_count, image, error);
    (void)close(descriptor);
    return status;
}
