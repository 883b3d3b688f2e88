/* Images in memory: named channels of floats; and their PNG encoding. Nothing here is collective. */
#ifndef KILN_COORDINATOR_OUTPUT_IMAGE_H
#define KILN_COORDINATOR_OUTPUT_IMAGE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "worker/base/color.h"
#include "worker/base/status.h"

enum { KILN_CHANNEL_NAME_SIZE = 64 };

/* Loops over at most so many values use one thread, since synchronizing threads would take longer. */
enum { KILN_IMAGE_ALONE = 1 << 14 };

struct kiln_image_channel {
    char name[KILN_CHANNEL_NAME_SIZE]; /* "R", "direct.G", ... */
    bool half;                         /* stored in the file as 16-bit float */
    float *values;                     /* width x height, top row first; owned by the image */
};

/* Channels are in byte order of their names, as in OpenEXR. */
struct kiln_image {
    uint32_t width, height;
    size_t channel_count;
    struct kiln_image_channel *channels;
    void *shared; /* mapping of all values after kiln_image_share; else NULL */
    size_t shared_bytes;
};

/* Creates an image with these channels, all zero. Names must be unique and shorter than KILN_CHANNEL_NAME_SIZE. */
int kiln_image_create(struct kiln_image **image, uint32_t width, uint32_t height, const char *const *names,
                      size_t count, struct kiln_error *error);
/* Likewise without values. The caller sets the `values` of channels to arrays from kiln_allocate, which the image then
 * owns. */
int kiln_image_create_empty(struct kiln_image **image, uint32_t width, uint32_t height, const char *const *names,
                            size_t count, struct kiln_error *error);
/* Maps the values of an image without values from a memory file that contains channel after channel, of exactly that
 * size. The descriptor is borrowed. */
int kiln_image_share(struct kiln_image *image, int memory, struct kiln_error *error);
void kiln_image_destroy(struct kiln_image **image);

/* The channel of that name, or NULL. */
struct kiln_image_channel *kiln_image_find(const struct kiln_image *image, const char *name);

/* The values of the three channels PREFIX + R, G, B, with a prefix such as "" or "direct.". False if one is missing. */
bool kiln_image_rgb(const struct kiln_image *image, const char *prefix, float *planes[3]);

/* Rec. 709 luminance of linear RGB. */
static inline float kiln_rgb_luminance(float r, float g, float b)
{
    return kiln_luminance_in_float((float[3]){r, g, b});
}

/* Encodes 8-bit pixels of `channels` (3: RGB, 4: RGB and straight alpha) as a PNG file in memory; *png is from
 * kiln_allocate. */
int kiln_png_encode_channels(const uint8_t *bytes, uint32_t width, uint32_t height, int channels, char **png,
                             size_t *size, struct kiln_error *error);
/* The same for RGB. */
int kiln_png_encode(const uint8_t *bytes, uint32_t width, uint32_t height, char **png, size_t *size,
                    struct kiln_error *error);

/* Publishes the image without tone mapping as a PNG file at the destination (publish.h): a pixel has the bytes 255 x
 * (scale x value + offset), rounded, between 0 and 255. `description` is as for kiln_png_write_bytes. */
int kiln_png_write_values(const char *directory, const char *name, const struct kiln_image *image, double scale,
                          double offset, const char *description, struct kiln_error *error);

/* Publishes 8-bit RGB pixels as a PNG file that contains KILN_MADE_BY and `description` (NULL: none) as text. */
int kiln_png_write_bytes(const char *directory, const char *name, const uint8_t *bytes, uint32_t width, uint32_t height,
                         const char *description, struct kiln_error *error);

#endif
