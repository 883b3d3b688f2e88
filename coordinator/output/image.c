#include "coordinator/output/image.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <stb_image_write.h>
#include <zlib.h>

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

int kiln_image_fill(struct kiln_image *image, struct kiln_error *error)
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
        status = kiln_image_fill(*image, error);
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

struct sink {
    char *bytes;
    size_t size, capacity;
    int status;
    struct kiln_error *error;
};

static void take_bytes(void *context, void *data, int size)
{
    struct sink *sink = context;
    if (sink->status != KILN_OK || size <= 0)
        return;
    sink->status =
        kiln_grow(&sink->bytes, &sink->capacity, sink->size + (size_t)size, 1, "a PNG file's bytes", sink->error);
    if (sink->status != KILN_OK)
        return;
    memcpy(sink->bytes + sink->size, data, (size_t)size);
    sink->size += (size_t)size;
}

int kiln_png_encode_channels(const uint8_t *bytes, uint32_t width, uint32_t height, int channels, char **png,
                             size_t *size, struct kiln_error *error)
{
    *png = NULL;
    *size = 0;
    /* the encoder uses int sizes, and temporarily about twice the memory of the picture */
    if (width == 0 || height == 0 || (uint64_t)width * height > 256ull << 20)
        return kiln_fail(error, KILN_CANNOT_CREATE, "a PNG of %u x %u pixels cannot be made (1 to 2^28 pixels)", width,
                         height);
    struct sink sink = {.error = error};
    if (!stbi_write_png_to_func(take_bytes, &sink, (int)width, (int)height, channels, bytes, channels * (int)width) &&
        sink.status == KILN_OK)
        sink.status = kiln_fail(error, KILN_SYSTEM, "out of memory for a PNG of %u x %u pixels", width, height);
    if (sink.status != KILN_OK) {
        kiln_free(&sink.bytes);
        return sink.status;
    }
    *png = sink.bytes;
    *size = sink.size;
    return KILN_OK;
}

int kiln_png_encode(const uint8_t *bytes, uint32_t width, uint32_t height, char **png, size_t *size,
                    struct kiln_error *error)
{
    return kiln_png_encode_channels(bytes, width, height, 3, png, size, error);
}

static void put_big_endian(uint8_t bytes[4], uint32_t value)
{
    for (int i = 0; i < 4; i++)
        bytes[i] = (uint8_t)(value >> (24 - 8 * i));
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
    put_big_endian(at + 8 + length, (uint32_t)crc32(crc32(0, NULL, 0), at + 4, (uInt)(length + 4)));
    *size += chunk;
    return KILN_OK;
}

int kiln_png_write_bytes(const char *directory, const char *name, const uint8_t *bytes, uint32_t width, uint32_t height,
                         const char *description, struct kiln_error *error)
{
    char *png = NULL;
    size_t size = 0;
    int status = kiln_png_encode(bytes, width, height, &png, &size, error);
    if (status == KILN_OK && description != NULL)
        status = add_text(&png, &size, "Description", description, error);
    if (status == KILN_OK)
        status = add_text(&png, &size, "Software", KILN_MADE_BY " " KILN_VERSION, error);
    if (status == KILN_OK)
        status = kiln_publish_bytes_below(directory, name, png, size, error);
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
    int status = kiln_allocate(&bytes, count * 3, 1, "a picture's bytes", error);
    for (size_t i = 0; status == KILN_OK && i < count; i++)
        for (size_t c = 0; c < 3; c++)
            bytes[3 * i + c] = value_byte(scale * (double)planes[c][i] + offset);
    if (status == KILN_OK)
        status = kiln_png_write_bytes(directory, name, bytes, image->width, image->height, description, error);
    kiln_free(&bytes);
    return status;
}
