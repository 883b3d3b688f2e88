/* Image decoders: textures to 8-bit RGBA, environments to linear float RGB.
 *
 * A header may claim any size, so nothing is allocated before three checks have passed, in this order:
 * - The bytes of the file can hold that many texels. Each format has a maximum: see image_formats.h.
 * - The image, and all images of the scene together, stay within the memory that the process may use (the limits
 *   below).
 * - The run lengths, chunks or scans that follow the header add up.
 *
 * Decoders: PNG by libpng, row by row to its final place; JPEG, and for OBJ files BMP and TGA, by stb_image; OpenEXR by
 * OpenEXRCore, chunk by chunk to its final place; Radiance by kiln's own image_radiance.c. */
#ifndef KILN_COORDINATOR_IMPORT_IMAGE_H
#define KILN_COORDINATOR_IMPORT_IMAGE_H

#include <stddef.h>
#include <stdint.h>

#include "coordinator/scene/builder.h"
#include "coordinator/import/confine.h"

enum { KILN_IMAGE_SIDE_MAX = 16384, KILN_ENVIRONMENT_SIDE_MAX = 65536 };

/* Memory limits of decoded images, as fractions of the memory that the importing process may use (its limit of address
 * space; KILN_IMAGE_MEMORY if it has none): one image an eighth, extra memory while decoding JPEG, BMP or TGA a third,
 * and all images of a scene half. Larger files raise the limits: by a number of texels for each byte of the files. */
#define KILN_IMAGE_MEMORY ((uint64_t)4 << 30)
#define KILN_TEXTURE_TEXELS_PER_BYTE ((uint64_t)64) /* for each byte of the scene's files */
#define KILN_STB_TEXELS_PER_BYTE ((uint64_t)16)     /* for each byte of the image itself */
#define KILN_STB_BYTES_PER_TEXEL ((uint64_t)17)     /* at most, while one is decoded */
/* Limits of an environment's texels. An environment is accepted if it meets one of two limits. The first is the number
 * of texels that an eighth of the memory holds, at BYTES_PER_TEXEL each. The second is FREE texels plus PER_BYTE for
 * each byte of its file, but MAX at most. */
#define KILN_ENVIRONMENT_BYTES_PER_TEXEL ((uint64_t)12)
#define KILN_ENVIRONMENT_TEXELS_FREE ((uint64_t)1 << 23)
#define KILN_ENVIRONMENT_TEXELS_PER_BYTE ((uint64_t)8)
#define KILN_ENVIRONMENT_TEXELS_MAX ((uint64_t)1 << 26)

/* Limit of the bytes of images that a scene refers to, counted at each reference: this multiple of the bytes of its
 * files. */
#define KILN_IMAGE_REPEATS ((uint64_t)64)

/* An image in the builder's texels, or its mean only. */
struct kiln_image {
    uint64_t hash[2]; /* of the encoded bytes */
    size_t size;      /* bytes of the encoded image; 0: a free slot of the table */
    uint64_t first;   /* offset of its texels in the builder, bytes */
    uint32_t width, height;
    bool decoded, averaged;
    double mean[4]; /* mean of each channel, 0..1, if `averaged` */
    bool planned;   /* its texels are counted already */
    bool judged;    /* kiln_image_no_normals has examined it, with this result: */
    const char *no_normals;
};

/* The images of one scene, in a hash table by content: each is decoded and stored once, however often and by whatever
 * names the scene refers to it. Set confine and builder, the rest to zero. Release with kiln_images_destroy. */
struct kiln_images {
    const struct kiln_confine *confine; /* borrowed: the size of the scene's files */
    struct kiln_builder *builder;       /* borrowed */
    struct kiln_image *slots;
    size_t slot_count, used;
    uint64_t texels; /* of images decoded so far, and of those planned */
    uint64_t bytes;  /* referred to so far */
};

/* An encoded image; borrowed. `where` begins error sentences ("scene.glb: images[2]"). */
struct kiln_image_bytes {
    const unsigned char *data;
    size_t size;
    bool any_format; /* accept BMP and TGA in addition to PNG and JPEG */
    const char *where;
};

/* Counts the texels of an image that will be decoded, by its header, so that a scene with too many is refused before
 * any image is decoded. Data that is not an image passes. KILN_BAD_INPUT: too large. */
int kiln_image_plan(struct kiln_images *images, const struct kiln_image_bytes *bytes, struct kiln_error *error);
/* Makes room for the texels of all planned images. */
int kiln_images_reserve(struct kiln_images *images, struct kiln_error *error);
/* Decodes the image into the builder's texels; *image is a copy of its entry. KILN_BAD_INPUT: not an image, broken, too
 * large. */
int kiln_image_append(struct kiln_images *images, const struct kiln_image_bytes *bytes, struct kiln_image *image,
                      struct kiln_error *error);
/* Computes the means of the image's channels. If it has not been decoded already, its texels are not kept. */
int kiln_image_mean(struct kiln_images *images, const struct kiln_image_bytes *bytes, struct kiln_image *image,
                    struct kiln_error *error);
/* The reason why a decoded image is no normal map; NULL: it may be one. The texels of each image are examined once. */
const char *kiln_image_no_normals(struct kiln_images *images, const struct kiln_image *image);
/* Whether the limit leaves room for `texels` more texels of images; if so, they are counted. */
bool kiln_images_have_room(struct kiln_images *images, uint64_t texels);
void kiln_images_destroy(struct kiln_images *images);

/* Decodes a lat-long environment (Radiance .hdr; OpenEXR: first part, R G B or Y, scan lines or tiles) into the
 * builder's environment texels. Negative values become 0, with a note. Infinite values, NaN and values above
 * KILN_LIGHT_MOST are refused. */
int kiln_image_append_environment(struct kiln_builder *builder, const unsigned char *bytes, size_t size,
                                  const char *where, uint32_t *width, uint32_t *height, struct kiln_error *error);

#endif
