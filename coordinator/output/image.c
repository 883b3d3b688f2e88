#include "coordinator/output/image.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <stb_image_write.h>

#include "coordinator/output/publish.h"
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

int kiln_image_create_empty(struct kiln_image **image, uint32_t width, uint32_t height, const char *const *names, size_t count,
                            struct kiln_error *error)
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
            status = kiln_allocate(&image->channels[i].values, (size_t)image->width * image->height, sizeof(float), "an image's pixels", error);
    return status;
}

int kiln_image_create(struct kiln_image **image, uint32_t width, uint32_t height, const char *const *names, size_t count,
                      struct kiln_error *error)
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
    if ((*image)->channels != NULL)
        for (size_t i = 0; i < (*image)->channel_count; i++)
            kiln_free(&(*image)->channels[i].values);
    kiln_free(&(*image)->channels);
    kiln_free(image);
}

struct kiln_image_channel *kiln_image_find(const struct kiln_image *image, const char *name)
{
    for (size_t i = 0; i < image->channel_count; i++)
        if (strcmp(image->channels[i].name, name) == 0)
            return &image->channels[i];
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

double kiln_auto_exposure(const struct kiln_image *image, const float *mask)
{
    float *rgb[3];
    if (!kiln_image_rgb(image, "", rgb))
        return 1.0;
    const size_t count = (size_t)image->width * image->height;
    double sum = 0.0;
    size_t used = 0;
    for (size_t i = 0; i < count; i++) {
        const float luminance = kiln_rgb_luminance(rgb[0][i], rgb[1][i], rgb[2][i]);
        if ((mask != NULL && !(mask[i] > 0.0f)) || !isfinite(luminance) || !(luminance > 0.0f))
            continue;
        sum += log((double)luminance);
        used++;
    }
    return used == 0 ? 1.0 : 0.18 / exp(sum / (double)used);
}

static uint8_t srgb_byte(double linear)
{
    const double clamped = linear < 0.0 ? 0.0 : linear > 1.0 ? 1.0 : linear;
    const double coded = clamped <= 0.0031308 ? 12.92 * clamped : 1.055 * pow(clamped, 1.0 / 2.4) - 0.055;
    return (uint8_t)(255.0 * coded + 0.5);
}

static void tone_map_pixel(const float rgb[3], double exposure, double white, uint8_t out[3])
{
    if (!isfinite(rgb[0]) || !isfinite(rgb[1]) || !isfinite(rgb[2])) {
        out[0] = out[2] = 255;
        out[1] = 0;
        return;
    }
    const double luminance = exposure * (double)kiln_rgb_luminance(rgb[0], rgb[1], rgb[2]);
    const double scale = luminance > 0.0 ? exposure * (1.0 + luminance / (white * white)) / (1.0 + luminance) : exposure;
    for (int c = 0; c < 3; c++)
        out[c] = srgb_byte(scale * (double)rgb[c]);
}

int kiln_tone_map(const struct kiln_image *image, double exposure, double white, uint8_t *bytes, struct kiln_error *error)
{
    float *planes[3];
    if (!kiln_image_rgb(image, "", planes))
        return kiln_fail(error, KILN_BAD_INPUT, "the image has no channels R, G and B to show");
    const size_t count = (size_t)image->width * image->height;
    for (size_t i = 0; i < count; i++) {
        const float rgb[3] = {planes[0][i], planes[1][i], planes[2][i]};
        tone_map_pixel(rgb, exposure, white, bytes + 3 * i);
    }
    return KILN_OK;
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

int kiln_png_encode_channels(const uint8_t *bytes, uint32_t width, uint32_t height, int channels, char **png, size_t *size,
                             struct kiln_error *error)
{
    *png = NULL;
    *size = 0;
    /* the encoder counts in int and takes about twice the picture while it works */
    if (width == 0 || height == 0 || (uint64_t)width * height > 256ull << 20)
        return kiln_fail(error, KILN_CANNOT_CREATE, "a PNG of %u x %u pixels cannot be made (1 to 2^28 pixels)", width, height);
    struct sink sink = {.error = error};
    if (!stbi_write_png_to_func(take_bytes, &sink, (int)width, (int)height, channels, bytes, channels * (int)width) && sink.status == KILN_OK)
        sink.status = kiln_fail(error, KILN_SYSTEM, "out of memory for a PNG of %u x %u pixels", width, height);
    if (sink.status != KILN_OK) {
        kiln_free(&sink.bytes);
        return sink.status;
    }
    *png = sink.bytes;
    *size = sink.size;
    return KILN_OK;
}

int kiln_png_encode(const uint8_t *bytes, uint32_t width, uint32_t height, char **png, size_t *size, struct kiln_error *error)
{
    return kiln_png_encode_channels(bytes, width, height, 3, png, size, error);
}

int kiln_png_write_bytes(const char *path, const uint8_t *bytes, uint32_t width, uint32_t height, struct kiln_error *error)
{
    char *png = NULL;
    size_t size = 0;
    int status = kiln_png_encode(bytes, width, height, &png, &size, error);
    if (status == KILN_OK)
        status = kiln_publish_bytes(path, png, size, error);
    kiln_free(&png);
    return status;
}

int kiln_png_write(const char *path, const struct kiln_image *image, const float *mask, double stops, struct kiln_error *error)
{
    uint8_t *bytes = NULL;
    int status = kiln_allocate(&bytes, (size_t)image->width * image->height * 3, 1, "a picture's bytes", error);
    if (status == KILN_OK)
        status = kiln_tone_map(image, kiln_auto_exposure(image, mask) * exp2(stops), INFINITY, bytes, error);
    if (status == KILN_OK)
        status = kiln_png_write_bytes(path, bytes, image->width, image->height, error);
    kiln_free(&bytes);
    return status;
}
