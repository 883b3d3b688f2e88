#include "coordinator/output/image.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <libdeflate.h>

#include "coordinator/files/publish.h"
#include "worker/base/memory.h"

static void place_channel(struct kiln_image *image, const char *name)
{
    size_t at = image->channel_count++;
    while (at > 0 && strcmp(image->channels[at - 1].name, name) > 0) {
        image->channels[at] = image->channels[at - 1];
        at--;
    }
    memset(&image->channels[at], 0, sizeof image->channels[at]);
    (void)snprintf(image->channels[at].name, sizeof image->channels[at].name, "%s", name);
}

int kiln_image_create_empty(struct kiln_image **image, uint32_t width, uint32_t height, const char *const *names,
                            size_t count, struct kiln_error *error)
{
    int status = kiln_allocate(image, 1, sizeof **image, "an image", error);
    if (status != KILN_OK)
        return status;
    struct kiln_image *made = *image;
    made->width = width;
    made->height = height;
    status = kiln_allocate(&made->channels, count, sizeof *made->channels, "an image's channels", error);
    for (size_t i = 0; status == KILN_OK && i < count; i++) {
        if (strlen(names[i]) >= KILN_CHANNEL_NAME_SIZE)
            status = kiln_fail(error, KILN_BAD_INPUT, "the channel name '%s' is longer than %d bytes", names[i],
                               KILN_CHANNEL_NAME_SIZE - 1);
        else
            place_channel(made, names[i]);
    }
    if (status != KILN_OK)
        kiln_image_destroy(image);
    return status;
}

static int fill(struct kiln_image *image, struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t i = 0; status == KILN_OK && i < image->channel_count; i++)
        if (image->channels[i].values == NULL)
            status = kiln_allocate(&image->channels[i].values, (size_t)image->width * image->height, sizeof(float),
                                   "an image's pixels", error);
    return status;
}

int kiln_image_share(struct kiln_image *image, int memory, struct kiln_error *error)
{
    const size_t values = (size_t)image->width * image->height, bytes = values * image->channel_count * sizeof(float);
    if (bytes == 0)
        return KILN_OK;
    void *map = mmap(NULL, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE, memory, 0);
    if (map == MAP_FAILED)
        return kiln_fail_errno(error, KILN_SYSTEM, "the %zu bytes of an image cannot be mapped", bytes);
    image->shared = map;
    image->shared_bytes = bytes;
    for (size_t i = 0; i < image->channel_count; i++)
        image->channels[i].values = (float *)map + i * values;
    return KILN_OK;
}

int kiln_image_create(struct kiln_image **image, uint32_t width, uint32_t height, const char *const *names,
                      size_t count, struct kiln_error *error)
{
    int status = kiln_image_create_empty(image, width, height, names, count, error);
    if (status == KILN_OK)
        status = fill(*image, error);
    if (status != KILN_OK)
        kiln_image_destroy(image);
    return status;
}

void kiln_image_destroy(struct kiln_image **image)
{
    if (*image == NULL)
        return;
    if ((*image)->shared != NULL)
        (void)munmap((*image)->shared, (*image)->shared_bytes);
    else if ((*image)->channels != NULL)
        for (size_t i = 0; i < (*image)->channel_count; i++)
            kiln_free(&(*image)->channels[i].values);
    kiln_free(&(*image)->channels);
    kiln_free(image);
}

struct kiln_image_channel *kiln_image_find(const struct kiln_image *image, const char *name)
{
    size_t low = 0, high = image->channel_count;
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        const int order = strcmp(image->channels[middle].name, name);
        if (order == 0)
            return &image->channels[middle];
        if (order < 0)
            low = middle + 1;
        else
            high = middle;
    }
    return NULL;
}

bool kiln_image_rgb(const struct kiln_image *image, const char *prefix, float *planes[3])
{
    for (int c = 0; c < 3; c++) {
        char name[KILN_CHANNEL_NAME_SIZE];
        (void)snprintf(name, sizeof name, "%s%c", prefix, "RGB"[c]);
        const struct kiln_image_channel *channel = kiln_image_find(image, name);
        if (channel == NULL)
            return false;
        planes[c] = channel->values;
    }
    return true;
}

/* ---- PNG ---- */

static void put_big_endian(uint8_t bytes[4], uint32_t value)
{
    for (int i = 0; i < 4; i++)
        bytes[i] = (uint8_t)(value >> (24 - 8 * i));
}

/* Predictions of a row's bytes (PNG, W3C Recommendation, section 9), of which one is chosen per row: difference to the
 * byte one pixel to the left, to the byte above, or to the mean of both. `above` of the first row is zero. */
enum { SUB = 1, UP = 2, AVERAGE = 3, PREDICTIONS = 4 };

static void predict(int by, const uint8_t *row, const uint8_t *above, size_t size, size_t pixel, uint8_t *to)
{
    for (size_t i = 0; i < pixel; i++) {
        const int up = above[i];
        to[i] = (uint8_t)(row[i] - (by == SUB ? 0 : by == UP ? up : up / 2));
    }
    if (by == SUB)
        for (size_t i = pixel; i < size; i++)
            to[i] = (uint8_t)(row[i] - row[i - pixel]);
    else if (by == UP)
        for (size_t i = pixel; i < size; i++)
            to[i] = (uint8_t)(row[i] - above[i]);
    else
        for (size_t i = pixel; i < size; i++)
            to[i] = (uint8_t)(row[i] - (row[i - pixel] + above[i]) / 2);
}

/* Returns the sum of the absolute values of bytes, taken as signed: a measure for their compressed size. */
static uint64_t size_of(const uint8_t *bytes, size_t count)
{
    uint64_t sum = 0;
    for (size_t i = 0; i < count; i++)
        sum += bytes[i] < 128 ? bytes[i] : 256u - bytes[i];
    return sum;
}

/* Writes a row with the best prediction, preceded by the prediction's number. `tried`: room for two rows; `above`: NULL
 * for the first row. */
static void put_row(const uint8_t *row, const uint8_t *above, size_t size, size_t pixel, uint8_t *tried, uint8_t *to)
{
    uint64_t least = UINT64_MAX;
    uint8_t *const zeros = tried + size;
    for (int by = SUB; by < PREDICTIONS; by++) {
        predict(by, row, above != NULL ? above : zeros, size, pixel, tried);
        const uint64_t found = size_of(tried, size);
        if (found >= least)
            continue;
        least = found;
        to[0] = (uint8_t)by;
        memcpy(to + 1, tried, size);
    }
}

/* Completes a chunk whose type and `size` bytes of data begin 4 bytes behind `at`. Returns the place of the next
 * chunk. */
static uint8_t *end_chunk(uint8_t *at, size_t size)
{
    put_big_endian(at, (uint32_t)size);
    put_big_endian(at + 8 + size, libdeflate_crc32(0, at + 4, size + 4));
    return at + 12 + size;
}

enum { PNG_SIGNATURE = 8, PNG_CHUNK = 12, PNG_HEADER = 13, PNG_LEVEL = 5 };

/* Makes the file from predicted rows. */
static int pack(const uint8_t *rows, size_t row_bytes, uint32_t width, uint32_t height, int channels, char **png,
                size_t *size, struct kiln_error *error)
{
    struct libdeflate_compressor *compressor = libdeflate_alloc_compressor(PNG_LEVEL);
    const size_t bytes = row_bytes * height, bound = libdeflate_zlib_compress_bound(compressor, bytes);
    int status;
    KILN_TRY(compressor != NULL ? KILN_OK : kiln_fail(error, KILN_SYSTEM, "out of memory: a PNG file's bytes"));
    KILN_TRY(kiln_allocate(png, PNG_SIGNATURE + 3 * PNG_CHUNK + PNG_HEADER + bound, 1, "a PNG file's bytes", error));
    uint8_t *at = (uint8_t *)*png;
    memcpy(at, "\x89PNG\r\n\x1a\n", PNG_SIGNATURE);
    at += PNG_SIGNATURE;
    memcpy(at + 4, "IHDR", 4);
    put_big_endian(at + 8, width);
    put_big_endian(at + 12, height);
    memcpy(at + 16, (const uint8_t[]){8, channels == 4 ? 6 : 2, 0, 0, 0}, 5); /* 8 bits; RGBA or RGB */
    at = end_chunk(at, PNG_HEADER);
    memcpy(at + 4, "IDAT", 4);
    at = end_chunk(at, libdeflate_zlib_compress(compressor, rows, bytes, at + 8, bound));
    memcpy(at + 4, "IEND", 4);
    at = end_chunk(at, 0);
    *size = (size_t)(at - (uint8_t *)*png);
end:
    libdeflate_free_compressor(compressor);
    return status;
}

int kiln_png_encode_channels(const uint8_t *bytes, uint32_t width, uint32_t height, int channels, char **png,
                             size_t *size, struct kiln_error *error)
{
    const size_t pixel = (size_t)channels, row = pixel * width, stride = row + 1;
    uint8_t *rows = NULL, *tried = NULL;
    *png = NULL;
    *size = 0;
    /* a chunk has less than 2^31 bytes */
    if (width == 0 || height == 0 || (uint64_t)width * height > 256ull << 20)
        return kiln_fail(error, KILN_CANNOT_CREATE, "a PNG of %u x %u pixels cannot be made (1 to 2^28 pixels)", width,
                         height);
    int status;
    KILN_TRY(kiln_allocate(&rows, height, stride, "a PNG file's bytes", error));
    KILN_TRY(kiln_allocate(&tried, 2, row, "a PNG file's bytes", error));
    for (size_t y = 0; y < height; y++)
        put_row(bytes + y * row, y > 0 ? bytes + (y - 1) * row : NULL, row, pixel, tried, rows + y * stride);
    KILN_TRY(pack(rows, stride, width, height, channels, png, size, error));
end:
    kiln_free(&rows);
    kiln_free(&tried);
    return status;
}

int kiln_png_encode(const uint8_t *bytes, uint32_t width, uint32_t height, char **png, size_t *size,
                    struct kiln_error *error)
{
    return kiln_png_encode_channels(bytes, width, height, 3, png, size, error);
}

/* Inserts a tEXt chunk, KEYWORD NUL TEXT, after the header of a PNG (8 bytes of signature, 25 of IHDR). The text must
 * be Latin-1; ours is ASCII. */
static int add_text(char **png, size_t *size, const char *keyword, const char *text, struct kiln_error *error)
{
    enum { HEADER = 8 + 25 };
    const size_t length = strlen(keyword) + 1 + strlen(text), chunk = 12 + length;
    size_t capacity = *size;
    const int status = kiln_grow(png, &capacity, *size + chunk + 1, 1, "a PNG file's bytes", error);
    if (status != KILN_OK)
        return status;
    uint8_t *at = (uint8_t *)*png + HEADER;
    memmove(at + chunk, at, *size - HEADER);
    put_big_endian(at, (uint32_t)length);
    memcpy(at + 4, "tEXt", 4);
    memcpy(at + 8, keyword, strlen(keyword) + 1);
    memcpy(at + 8 + strlen(keyword) + 1, text, strlen(text));
    put_big_endian(at + 8 + length, libdeflate_crc32(0, at + 4, length + 4));
    *size += chunk;
    return KILN_OK;
}

int kiln_png_write_bytes(const char *directory, const char *name, const uint8_t *bytes, uint32_t width, uint32_t height,
                         const char *description, struct kiln_error *error)
{
    char *png = NULL;
    size_t size = 0;
    int status;
    KILN_TRY(kiln_png_encode(bytes, width, height, &png, &size, error));
    if (description != NULL)
        KILN_TRY(add_text(&png, &size, "Description", description, error));
    KILN_TRY(add_text(&png, &size, "Software", KILN_MADE_BY " " KILN_VERSION, error));
    KILN_TRY(kiln_publish_bytes_below(directory, name, png, size, error));
end:
    kiln_free(&png);
    return status;
}

static uint8_t value_byte(double value) { return (uint8_t)(255.0 * fmin(fmax(value, 0.0), 1.0) + 0.5); }

int kiln_png_write_values(const char *directory, const char *name, const struct kiln_image *image, double scale,
                          double offset, const char *description, struct kiln_error *error)
{
    const size_t count = (size_t)image->width * image->height;
    float *planes[3];
    uint8_t *bytes = NULL;
    if (!kiln_image_rgb(image, "", planes))
        return kiln_fail(error, KILN_BAD_INPUT, "the image has no channels R, G and B to show");
    int status;
    KILN_TRY(kiln_allocate(&bytes, count * 3, 1, "a picture's bytes", error));
    for (size_t i = 0; i < count; i++)
        for (size_t c = 0; c < 3; c++)
            bytes[3 * i + c] = value_byte(scale * (double)planes[c][i] + offset);
    KILN_TRY(kiln_png_write_bytes(directory, name, bytes, image->width, image->height, description, error));
end:
    kiln_free(&bytes);
    return status;
}
