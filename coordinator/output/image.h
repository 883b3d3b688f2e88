/* Images in memory: named channels of floats; and their tone mapping and PNG encoding. Nothing here is collective. */
#ifndef KILN_COORDINATOR_OUTPUT_IMAGE_H
#define KILN_COORDINATOR_OUTPUT_IMAGE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "worker/base/color.h"
#include "worker/base/status.h"

enum { KILN_CHANNEL_NAME_SIZE = 64 };

/* Loops over at most so many values use one thread: waiting for the others takes longer. */
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
/* The same without values. The caller may set the `values` of channels to arrays from kiln_allocate, which the image
 * then owns; kiln_image_fill allocates those of the other channels, all zero. */
int kiln_image_create_empty(struct kiln_image **image, uint32_t width, uint32_t height, const char *const *names,
                            size_t count, struct kiln_error *error);
int kiln_image_fill(struct kiln_image *image, struct kiln_error *error);
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

/* Exposure: radiance is multiplied by `scale`; scaled values of `white` and more are shown white. */
struct kiln_exposure {
    double scale, white;
};

/* Automatic exposure: the scale that brings the logarithmic mean of luminance to 0.18 (Reinhard et al. 2002), and as
 * white the 99th percentile of scaled luminance, at least 0.5. Uses pixels with finite luminance above 0 and, unless
 * `mask` is NULL, mask > 0. The mean leaves out the darkest and the brightest 5 % of them, so that neither a lamp nor a
 * black corner determines it. Without such pixels the scale is 1 and white infinite. Deterministic. */
struct kiln_exposure kiln_auto_exposure(const struct kiln_image *image, const float *mask);

/* Tone-maps to 8-bit sRGB, 3 x width x height bytes at `bytes`. Applies Reinhard's operator to luminance,
 * L' = s L (1 + s L / w^2) / (1 + s L) with s = exposure and white point w (infinite: s L / (1 + s L)), keeps the hue,
 * and converts linear Rec. 709 to sRGB with rounding. Pixels that are not finite become magenta, so that errors are
 * visible. KILN_BAD_INPUT if the image has no R, G, B. */
int kiln_tone_map(const struct kiln_image *image, double exposure, double white, uint8_t *bytes,
                  struct kiln_error *error);

/* Encodes 8-bit pixels of `channels` (3: RGB, 4: RGB and straight alpha) as a PNG file in memory; *png is from
 * kiln_allocate. */
int kiln_png_encode_channels(const uint8_t *bytes, uint32_t width, uint32_t height, int channels, char **png,
                             size_t *size, struct kiln_error *error);
/* The same for RGB. */
int kiln_png_encode(const uint8_t *bytes, uint32_t width, uint32_t height, char **png, size_t *size,
                    struct kiln_error *error);

/* Tone-maps the image with automatic exposure times 2^stops, and publishes it as a PNG file at the destination
 * (publish.h). `mask` is as for kiln_auto_exposure, `description` as for kiln_png_write_bytes. */
int kiln_png_write(const char *directory, const char *name, const struct kiln_image *image, const float *mask,
                   double stops, const char *description, struct kiln_error *error);

/* The same without tone mapping: a pixel has the bytes 255 x (scale x value + offset), rounded, between 0 and 255. */
int kiln_png_write_values(const char *directory, const char *name, const struct kiln_image *image, double scale,
                          double offset, const char *description, struct kiln_error *error);

/* Publishes 8-bit RGB pixels as a PNG file that contains KILN_MADE_BY and `description` (NULL: none) as text. */
int kiln_png_write_bytes(const char *directory, const char *name, const uint8_t *bytes, uint32_t width, uint32_t height,
                         const char *description, struct kiln_error *error);

#endif
