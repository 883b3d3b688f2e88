/* Decoding images: textures to 8-bit RGBA, environments to linear float RGB.
 *
 * A header may claim what it likes, so nothing is allocated before three questions are answered, in this order:
 * 1. Can the bytes that are there hold that many texels at all? Each format has a most: see image_formats.h.
 * 2. Is the picture, together with those before it, within what a scene of this size may take in memory (the limits
 * below)?
 * 3. Do the run lengths, chunks or scans that follow the header add up?
 *
 * What decodes what: PNG libpng, row by row to its final place; JPEG, and for OBJ files BMP and TGA, stb_image; OpenEXR
 * OpenEXRCore, chunk by chunk to its final place; Radiance kiln's own radiance.c. */
#ifndef KILN_COORDINATOR_IMPORT_IMAGE_H
#define KILN_COORDINATOR_IMPORT_IMAGE_H

#include <stddef.h>
#include <stdint.h>

#include "coordinator/scene/builder.h"
#include "coordinator/import/confine.h"

enum { KILN_IMAGE_SIDE_MAX = 16384, KILN_ENVIRONMENT_SIDE_MAX = 65536 };

/* Texels of all textures of a scene, 4 bytes each: so many for nothing, and so many more for each byte of the scene's
 * files. A picture with more texels to a byte has hardly any detail: it may as well be smaller. */
#define KILN_TEXTURE_TEXELS_FREE ((uint64_t)1 << 25)
#define KILN_TEXTURE_TEXELS_PER_BYTE ((uint64_t)64)
/* A JPEG, BMP or TGA is decoded with up to 17 bytes a texel besides: one picture at a time, by its own bytes. */
#define KILN_STB_TEXELS_FREE ((uint64_t)1 << 24)
#define KILN_STB_TEXELS_PER_BYTE ((uint64_t)16)
/* Texels of an environment, 12 bytes each; the most is for any size of file. */
#define KILN_ENVIRONMENT_TEXELS_FREE ((uint64_t)1 << 23)
#define KILN_ENVIRONMENT_TEXELS_PER_BYTE ((uint64_t)8)
#define KILN_ENVIRONMENT_TEXELS_MAX ((uint64_t)1 << 26)
/* Largest radiance of an environment's texel, as it is and after scaling: sums over all of them stay within float. */
#define KILN_ENVIRONMENT_RADIANCE_MAX 1e30f

/* Bytes of pictures that a scene may refer to, counted at each image that names them: so many times the bytes of its
 * files. */
#define KILN_IMAGE_REPEATS ((uint64_t)64)

/* A picture in the builder's texels, or its mean only. */
struct kiln_image {
    uint64_t hash[2]; /* of its encoded bytes */
    size_t size;      /* of these; 0: a free place of the table */
    uint64_t first;   /* texel byte in the builder */
    uint32_t width, height;
    bool decoded, averaged;
    double mean[4]; /* of each channel, 0..1, where averaged */
};

/* The pictures of one scene, found by their bytes: each is decoded and stored once, however often and by whatever name
 * the scene refers to it. Set confine and builder, the rest to zero; release with kiln_images_destroy. */
struct kiln_images {
    const struct kiln_confine *confine; /* borrowed: the size of the scene's files */
    struct kiln_builder *builder;       /* borrowed */
    struct kiln_image *slots;
    size_t slot_count, used;
    uint64_t texels; /* decoded so far */
    uint64_t bytes;  /* referred to so far */
};

/* Encoded bytes, borrowed. `where` begins the sentence ("scene.glb: images[2]"). */
struct kiln_image_bytes {
    const unsigned char *data;
    size_t size;
    bool any_format; /* BMP and TGA besides PNG and JPEG */
    const char *where;
};

/* The picture as texels of the builder; *image is a copy. KILN_BAD_INPUT: not an image, broken, too large. */
int kiln_image_append(struct kiln_images *images, const struct kiln_image_bytes *bytes, struct kiln_image *image,
                      struct kiln_error *error);
/* The picture with the means of its channels; of one that is not decoded already the texels are not kept. */
int kiln_image_mean(struct kiln_images *images, const struct kiln_image_bytes *bytes, struct kiln_image *image,
                    struct kiln_error *error);
void kiln_images_destroy(struct kiln_images *images);

/* Decodes a lat-long environment (Radiance .hdr, or OpenEXR: first part, R G B or Y, scan lines or tiles) into the
 * builder's environment texels. Negative values become 0 with a note; infinite ones, NaN and those above
 * KILN_ENVIRONMENT_RADIANCE_MAX are refused. */
int kiln_image_append_environment(struct kiln_builder *builder, const unsigned char *bytes, size_t size,
                                  const char *where, uint32_t *width, uint32_t *height, struct kiln_error *error);

#endif
