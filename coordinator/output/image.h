/* Pictures in memory: planes of floats with names, and how they become something to look at. Nothing here is
 * collective. */
#ifndef KILN_COORDINATOR_OUTPUT_IMAGE_H
#define KILN_COORDINATOR_OUTPUT_IMAGE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "worker/base/color.h"
#include "worker/base/status.h"

enum { KILN_CHANNEL_NAME_SIZE = 64 };

struct kiln_image_channel {
    char name[KILN_CHANNEL_NAME_SIZE]; /* "R", "direct.G", ... */
    bool half;                         /* stored (or to be stored) as 16-bit float */
    float *values;                     /* width x height, top row first; owned by the image */
};

/* Channels stand in the order of their names' bytes, as OpenEXR keeps them. */
struct kiln_image {
    uint32_t width, height;
    size_t channel_count;
    struct kiln_image_channel *channels;
    void *shared; /* where all values lie when kiln_image_share has put them there; else NULL */
    size_t shared_bytes;
};

/* Makes an image with these channels, all zero. Names must be unique and shorter than KILN_CHANNEL_NAME_SIZE. */
int kiln_image_create(struct kiln_image **image, uint32_t width, uint32_t height, const char *const *names,
                      size_t count, struct kiln_error *error);
/* The same without values: who has them already puts his own (from kiln_allocate) in, and lets the rest be made, all
 * zero. */
int kiln_image_create_empty(struct kiln_image **image, uint32_t width, uint32_t height, const char *const *names,
                            size_t count, struct kiln_error *error);
int kiln_image_fill(struct kiln_image *image, struct kiln_error *error);
/* Lets an image without values have those in a file in memory, which is as long as they are: channel after channel. The
 * descriptor is borrowed. */
int kiln_image_share(struct kiln_image *image, int memory, struct kiln_error *error);
void kiln_image_destroy(struct kiln_image **image);

/* The channel of that name or NULL. */
struct kiln_image_channel *kiln_image_find(const struct kiln_image *image, const char *name);

/* The three planes called PREFIX + R, G, B ("" or "direct."). False when one is missing. */
bool kiln_image_rgb(const struct kiln_image *image, const char *prefix, float *planes[3]);

/* Rec. 709 luminance of linear RGB. */
static inline float kiln_rgb_luminance(float r, float g, float b)
{
    return kiln_luminance_in_float((float[3]){r, g, b});
}

/* How radiance is shown: multiplied by `scale`, and white from `white` on, after that. */
struct kiln_exposure {
    double scale, white;
};

/* The scale that makes the picture's logarithmic mean 0.18 (Reinhard et al. 2002), and as white what only one pixel in
 * a hundred exceeds, but 0.5 at least. Over pixels with finite luminance above 0 and, where `mask` is not NULL, mask >
 * 0; the mean is over what lies between the twentieth part that is darkest and the one that is brightest, so that
 * neither a lamp nor a black corner sets it. Scale 1 and no white when there are no such pixels. Deterministic. */
struct kiln_exposure kiln_auto_exposure(const struct kiln_image *image, const float *mask);

/* Reinhard's operator on luminance, L' = s L (1 + s L / w^2) / (1 + s L) with s = exposure and white point w (infinite:
 * the plain s L / (1 + s L)), keeping hue, then linear Rec. 709 to sRGB, 8 bits, rounded. `bytes` receives 3 x width x
 * height. KILN_BAD_INPUT when the image has no R, G, B. Pixels that are not finite become magenta: an error must be
 * seen. */
int kiln_tone_map(const struct kiln_image *image, double exposure, double white, uint8_t *bytes,
                  struct kiln_error *error);

/* 8-bit bytes of `channels` (3: RGB, 4: RGB and alpha as it is) to a PNG file's bytes in memory (*png from
 * kiln_allocate). */
int kiln_png_encode_channels(const uint8_t *bytes, uint32_t width, uint32_t height, int channels, char **png,
                             size_t *size, struct kiln_error *error);
/* The same of RGB. */
int kiln_png_encode(const uint8_t *bytes, uint32_t width, uint32_t height, char **png, size_t *size,
                    struct kiln_error *error);

/* Tone-maps, automatically exposed, and publishes a PNG file at a place (publish.h); `stops` is added to the automatic
 * exposure, 2^stops times. `description` is as for kiln_png_write_bytes. */
int kiln_png_write(const char *directory, const char *name, const struct kiln_image *image, const float *mask,
                   double stops, const char *description, struct kiln_error *error);

/* Publishes 8-bit RGB bytes as a PNG file, with KILN_MADE_BY and `description` (NULL: none) as text in it. */
int kiln_png_write_bytes(const char *directory, const char *name, const uint8_t *bytes, uint32_t width, uint32_t height,
                         const char *description, struct kiln_error *error);

#endif
