#include "coordinator/output/exr_strips.h"

#include <stdio.h>
#include <string.h>
#include <unistd.h>
#include <xxhash.h>

#include "coordinator/output/exr_private.h"
#include "coordinator/files/publish.h"
#include "worker/base/memory.h"

static uint32_t strip_rows(const struct kiln_image *image, uint32_t y)
{
    return image->height - y < KILN_EXR_ROWS ? image->height - y : KILN_EXR_ROWS;
}

/* ---- one strip ---- */

/* An output stream of the library in memory. */
struct memory_file {
    uint8_t *bytes;
    size_t size, capacity;
};

static int64_t write_memory(exr_const_context_t context, void *user, const void *buffer, uint64_t size, uint64_t offset,
                            exr_stream_error_func_ptr_t report)
{
    struct memory_file *m = user;
    (void)context;
    (void)report;
    if (kiln_grow(&m->bytes, &m->capacity, offset + size, 1, "a packed strip", NULL) != KILN_OK)
        return -1;
    if (offset > m->size) /* the library writes the table of chunks last, before the chunks in the file */
        memset(m->bytes + m->size, 0, offset - m->size);
    memcpy(m->bytes + offset, buffer, size);
    m->size = offset + size > m->size ? offset + size : m->size;
    return (int64_t)size;
}

static int64_t read_memory(exr_const_context_t context, void *user, void *buffer, uint64_t size, uint64_t offset,
                           exr_stream_error_func_ptr_t report)
{
    const struct memory_file *m = user;
    (void)context;
    (void)report;
    if (offset >= m->size)
        return 0;
    const size_t step = m->size - offset < size ? m->size - offset : size;
    memcpy(buffer, m->bytes + offset, step);
    return (int64_t)step;
}

static int64_t size_of_memory(exr_const_context_t context, void *user)
{
    (void)context;
    return (int64_t)((const struct memory_file *)user)->size;
}

/* Makes an image of a strip's rows, which borrows their values. Free its channels. */
static int view_strip(const struct kiln_image *image, uint32_t y, struct kiln_image *view, struct kiln_error *error)
{
    struct kiln_image_channel *channels = NULL;
    if (y >= image->height)
        return kiln_fail(error, KILN_BUG, "row %u of an image of %u rows is to be packed alone", y, image->height);
    const int status =
        kiln_allocate(&channels, image->channel_count, sizeof *channels, "the channels of a strip", error);
    if (status != KILN_OK)
        return status;
    *view = (struct kiln_image){.width = image->width,
                                .height = strip_rows(image, y),
                                .channel_count = image->channel_count,
                                .channels = channels};
    for (size_t c = 0; c < image->channel_count; c++) {
        channels[c] = image->channels[c];
        channels[c].values += (size_t)y * image->width;
    }
    return KILN_OK;
}

/* Writes a file in memory with this strip alone. *packed: size of its only chunk, which is at the end. */
static exr_result_t pack_alone(const struct kiln_image *view, struct memory_file *m, size_t *packed)
{
    exr_context_initializer_t setup = EXR_DEFAULT_CONTEXT_INITIALIZER;
    setup.error_handler_fn = exr_stay_silent;
    setup.user_data = m;
    setup.write_fn = write_memory;
    exr_context_t file = NULL;
    struct exr_packer packer = EXR_PACKER;
    exr_result_t code = exr_start_write(&file, "a strip", EXR_WRITE_FILE_DIRECTLY, &setup);
    if (code != EXR_ERR_SUCCESS)
        return code;
    code = exr_declare(file, view, NULL, 0);
    if (code == EXR_ERR_SUCCESS)
        code = exr_pack_chunk(&packer, file, view, 0);
    if (code == EXR_ERR_SUCCESS) {
        *packed = packer.encoder.compressed_bytes;
        code = packer.write(&packer.encoder);
    }
    (void)exr_packer_end(&packer, file);
    const exr_result_t finished = exr_finish(&file);
    return code == EXR_ERR_SUCCESS ? finished : code;
}

static exr_result_t unpack_alone(struct memory_file *m, const struct kiln_image *found)
{
    exr_context_initializer_t setup = EXR_DEFAULT_CONTEXT_INITIALIZER;
    setup.error_handler_fn = exr_stay_silent;
    setup.flags = EXR_CONTEXT_FLAG_DISABLE_CHUNK_RECONSTRUCTION;
    setup.user_data = m;
    setup.read_fn = read_memory;
    setup.size_fn = size_of_memory;
    exr_context_t file = NULL;
    exr_result_t code = exr_start_read(&file, "a strip", &setup);
    if (code == EXR_ERR_SUCCESS)
        code = exr_read_chunks(file, 0, found);
    (void)exr_finish(&file);
    return code;
}

static int check_alone(const struct kiln_image *view, struct memory_file *m, struct kiln_error *error)
{
    const size_t values = (size_t)view->width * view->height;
    const char **names = NULL;
    struct kiln_image *found = NULL;
    int status;
    KILN_TRY(kiln_allocate(&names, view->channel_count, sizeof *names, "the channels of a strip", error));
    for (size_t c = 0; c < view->channel_count; c++)
        names[c] = view->channels[c].name;
    KILN_TRY(kiln_image_create(&found, view->width, view->height, names, view->channel_count, error));
    const exr_result_t code = unpack_alone(m, found);
    if (code != EXR_ERR_SUCCESS)
        KILN_TRY(exr_failed(KILN_IO, "a packed strip", "unpacked", code, error));
    for (size_t c = 0; c < view->channel_count; c++)
        if (exr_count_same(&view->channels[c], &found->channels[c], values) < values)
            KILN_TRY(kiln_fail(error, KILN_IO, "%u rows of channel %s do not decompress to their values", view->height,
                               view->channels[c].name));
end:
    kiln_free(&names);
    kiln_image_destroy(&found);
    return status;
}

int exr_make_header(const char *path, const struct kiln_image *image, uint32_t height,
                    const struct kiln_exr_attribute *attributes, size_t attribute_count, uint8_t **header, size_t *size,
                    struct kiln_error *error)
{
    struct kiln_image whole = *image;
    struct memory_file m = {0};
    exr_context_initializer_t setup = EXR_DEFAULT_CONTEXT_INITIALIZER;
    setup.error_handler_fn = exr_stay_silent;
    setup.user_data = &m;
    setup.write_fn = write_memory;
    exr_context_t file = NULL;
    int32_t rows = 0;
    whole.height = height;
    exr_result_t code = exr_start_write(&file, "a header", EXR_WRITE_FILE_DIRECTLY, &setup);
    if (code == EXR_ERR_SUCCESS)
        code = exr_declare(file, &whole, attributes, attribute_count);
    if (code == EXR_ERR_SUCCESS)
        code = exr_get_scanlines_per_chunk(file, 0, &rows);
    *size = m.size; /* exr_finish adds an empty table */
    (void)exr_finish(&file);
    *header = m.bytes;
    if (code != EXR_ERR_SUCCESS)
        return exr_failed(KILN_CANNOT_CREATE, path, "started", code, error);
    if (rows != KILN_EXR_ROWS)
        return kiln_fail(error, KILN_BUG, "'%s': the library packs %d rows at a time, not %d", path, (int)rows,
                         KILN_EXR_ROWS);
    return KILN_OK;
}

uint64_t kiln_exr_strip_values(const struct kiln_image *image, uint32_t y)
{
    const size_t count = (size_t)strip_rows(image, y) * image->width;
    uint64_t hash = 0;
    for (size_t c = 0; c < image->channel_count; c++)
        hash = XXH3_64bits_withSeed(image->channels[c].values + (size_t)y * image->width, count * sizeof(float), hash);
    return hash;
}

int kiln_exr_strip_pack(const struct kiln_image *image, uint32_t y, struct kiln_exr_strip *strip,
                        struct kiln_error *error)
{
    struct kiln_image view;
    struct memory_file m = {0};
    *strip = (struct kiln_exr_strip){0};
    int status = view_strip(image, y, &view, error);
    if (status != KILN_OK)
        return status;
    const exr_result_t code = pack_alone(&view, &m, &strip->size);
    if (code != EXR_ERR_SUCCESS)
        status = exr_failed(KILN_SYSTEM, "a strip", "packed", code, error);
    if (status == KILN_OK)
        status = check_alone(&view, &m, error);
    if (status == KILN_OK) {
        memmove(m.bytes, m.bytes + m.size - strip->size, strip->size);
        strip->bytes = m.bytes;
        strip->hash = XXH3_64bits(strip->bytes, strip->size);
        strip->values = kiln_exr_strip_values(image, y);
    } else
        kiln_free(&m.bytes);
    kiln_free(&view.channels);
    return status;
}

/* ---- a file of strips ---- */

struct kiln_exr_file {
    const struct kiln_image *image;
    struct kiln_publish place;
    struct exr_output_stream stream; /* the descriptor is -1 when it is closed */
    exr_context_t context;
    uint32_t written, strips;
    uint64_t *hashes; /* of each strip */
    bool there;       /* the temporary file exists */
};

/* Reports a failed library call. If the stream failed, it has set a message of its own. */
static int stream_failed(struct kiln_exr_file *f, const char *act, exr_result_t code, struct kiln_error *error)
{
    return f->stream.status != KILN_OK ? f->stream.status : exr_failed(KILN_IO, f->place.temporary, act, code, error);
}

static int begin_file(struct kiln_exr_file *f, const struct kiln_exr_attribute *attributes, size_t attribute_count,
                      struct kiln_error *error)
{
    int32_t rows = 0, strips = 0;
    exr_context_initializer_t setup = EXR_DEFAULT_CONTEXT_INITIALIZER;
    setup.error_handler_fn = exr_stay_silent;
    setup.user_data = &f->stream;
    setup.write_fn = exr_write_stream;
    f->stream.error = error;
    exr_result_t code = exr_start_write(&f->context, f->place.temporary, EXR_WRITE_FILE_DIRECTLY, &setup);
    if (code != EXR_ERR_SUCCESS)
        return exr_failed(KILN_CANNOT_CREATE, f->place.temporary, "started", code, error);
    code = exr_declare(f->context, f->image, attributes, attribute_count);
    if (code == EXR_ERR_SUCCESS)
        code = exr_get_scanlines_per_chunk(f->context, 0, &rows);
    if (code == EXR_ERR_SUCCESS)
        code = exr_get_chunk_count(f->context, 0, &strips);
    if (code != EXR_ERR_SUCCESS)
        return stream_failed(f, "started", code, error);
    if (rows != KILN_EXR_ROWS || strips != (int32_t)f->strips)
        return kiln_fail(error, KILN_BUG, "'%s': the library packs %d rows at a time in %d strips, not %d in %u",
                         f->place.temporary, (int)rows, (int)strips, KILN_EXR_ROWS, f->strips);
    return KILN_OK;
}

int kiln_exr_file_create(struct kiln_exr_file **file, const char *directory, const char *name,
                         const struct kiln_image *image, const struct kiln_exr_attribute *attributes,
                         size_t attribute_count, struct kiln_error *error)
{
    int status = kiln_allocate(file, 1, sizeof **file, "a lightmap's file", error);
    if (status != KILN_OK)
        return status;
    struct kiln_exr_file *f = *file;
    f->image = image;
    f->strips = (image->height + KILN_EXR_ROWS - 1) / KILN_EXR_ROWS;
    f->stream = (struct exr_output_stream){.descriptor = -1, .path = f->place.temporary};
    f->place = (struct kiln_publish){.folder = {.descriptor = -1}, .stream = -1, .scratch = -1};
    KILN_TRY(exr_check_image(name, image, error));
    KILN_TRY(kiln_allocate(&f->hashes, f->strips, sizeof *f->hashes, "a lightmap's strips", error));
    KILN_TRY(kiln_publish_begin(&f->place, directory, name, error));
    KILN_TRY(kiln_publish_open(&f->place, &f->stream.descriptor, error));
    f->there = true;
    KILN_TRY(begin_file(f, attributes, attribute_count, error));
end:
    if (status != KILN_OK)
        kiln_exr_file_destroy(file);
    return status;
}

int kiln_exr_file_append(struct kiln_exr_file *f, const void *bytes, size_t size, uint64_t hash,
                         struct kiln_error *error)
{
    if (f->written >= f->strips)
        return kiln_fail(error, KILN_BUG, "'%s': more strips than its %u are to be written", f->place.temporary,
                         f->strips);
    f->stream.error = error;
    const exr_result_t code = exr_write_scanline_chunk(f->context, 0, (int)(f->written * KILN_EXR_ROWS), bytes, size);
    if (code != EXR_ERR_SUCCESS)
        return stream_failed(f, "written", code, error);
    f->hashes[f->written++] = hash;
    return KILN_OK;
}

/* Closes the file, and counts its strips, since exr_finish succeeds even for an incomplete file. */
static int close_file(struct kiln_exr_file *f, struct kiln_error *error)
{
    f->stream.error = error;
    const exr_result_t code = exr_finish(&f->context);
    int status =
        code == EXR_ERR_SUCCESS && f->stream.status == KILN_OK ? KILN_OK : stream_failed(f, "finished", code, error);
    if (close(f->stream.descriptor) != 0 && status == KILN_OK)
        status = kiln_fail_errno(error, KILN_IO, "'%s' cannot be closed", f->place.temporary);
    f->stream.descriptor = -1;
    if (status == KILN_OK && f->written != f->strips)
        status =
            kiln_fail(error, KILN_BUG, "'%s': %u of %u strips were written", f->place.temporary, f->written, f->strips);
    return status;
}

/* Whether the header of the file describes the image. */
static bool same_header(exr_const_context_t file, const struct kiln_image *image)
{
    exr_attr_box2i_t window;
    const exr_attr_chlist_t *list = NULL;
    if (exr_get_data_window(file, 0, &window) != EXR_ERR_SUCCESS || exr_get_channels(file, 0, &list) != EXR_ERR_SUCCESS)
        return false;
    bool same = window.min.x == 0 && window.min.y == 0 && window.max.x == (int32_t)image->width - 1 &&
                window.max.y == (int32_t)image->height - 1 && (size_t)list->num_channels == image->channel_count;
    for (size_t c = 0; same && c < image->channel_count; c++)
        same = strcmp(list->entries[c].name.str, image->channels[c].name) == 0 &&
               list->entries[c].pixel_type == (image->channels[c].half ? EXR_PIXEL_HALF : EXR_PIXEL_FLOAT);
    return same;
}

/* Whether the strip is at the place given in the file's table, with the hash of what was written. */
static bool same_strip(exr_const_context_t file, uint32_t strip, uint64_t hash)
{
    exr_chunk_info_t chunk;
    uint8_t *bytes = NULL;
    if (exr_read_scanline_chunk_info(file, 0, (int)(strip * KILN_EXR_ROWS), &chunk) != EXR_ERR_SUCCESS ||
        kiln_allocate(&bytes, chunk.packed_size, 1, "a strip", NULL) != KILN_OK)
        return false;
    const bool same =
        exr_read_chunk(file, 0, &chunk, bytes) == EXR_ERR_SUCCESS && XXH3_64bits(bytes, chunk.packed_size) == hash;
    kiln_free(&bytes);
    return same;
}

static int read_back(const struct kiln_exr_file *f, struct kiln_error *error)
{
    exr_context_initializer_t setup = EXR_DEFAULT_CONTEXT_INITIALIZER;
    setup.error_handler_fn = exr_stay_silent;
    setup.flags = EXR_CONTEXT_FLAG_DISABLE_CHUNK_RECONSTRUCTION;
    exr_context_t file = NULL;
    const exr_result_t code = exr_start_read(&file, f->place.opens, &setup);
    if (code != EXR_ERR_SUCCESS)
        return exr_failed(KILN_IO, f->place.temporary, "read", code, error);
    const bool header = same_header(file, f->image);
    uint32_t good = header ? f->strips : 0;
#pragma omp parallel for schedule(dynamic, 4) reduction(min : good)
    for (uint32_t s = 0; s < f->strips; s++)
        if (header && s < good && !same_strip(file, s, f->hashes[s]))
            good = s;
    (void)exr_finish(&file);
    if (!header)
        return kiln_fail(error, KILN_IO, "'%s' does not read back as it was written: size or channels differ",
                         f->place.temporary);
    if (good < f->strips)
        return kiln_fail(error, KILN_IO, "'%s' does not read back as it was written: row %u and the following",
                         f->place.temporary, good * KILN_EXR_ROWS);
    return KILN_OK;
}

int kiln_exr_file_publish(struct kiln_exr_file *f, struct kiln_error *error)
{
    int status = close_file(f, error);
    if (status == KILN_OK)
        status = read_back(f, error);
    if (status != KILN_OK)
        return status;
    f->there = false; /* kiln_publish_finish removes it if it cannot be published */
    return kiln_publish_finish(&f->place, error);
}

void kiln_exr_file_destroy(struct kiln_exr_file **file)
{
    struct kiln_exr_file *f = *file;
    if (f == NULL)
        return;
    f->stream.error = NULL;
    if (f->context != NULL)
        (void)exr_finish(&f->context);
    if (f->stream.descriptor >= 0)
        (void)close(f->stream.descriptor);
    if (f->there)
        kiln_publish_abandon(&f->place);
    kiln_publish_close(&f->place);
    kiln_free(&f->hashes);
    kiln_free(file);
}
