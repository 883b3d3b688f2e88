/* Decoding images: textures to 8-bit RGBA, environments to linear float RGB. The dimensions are judged from the header, before
 * anything is decoded. */
#ifndef KILN_COORDINATOR_IMPORT_IMAGE_H
#define KILN_COORDINATOR_IMPORT_IMAGE_H

#include <stddef.h>
#include <stdint.h>

#include "coordinator/import/builder.h"

enum { KILN_IMAGE_SIDE_MAX = 16384 };

/* How much all textures of a scene may take: 2^25 texels for nothing, and 256 more for each byte of the encoded images, which is
 * more than any honest image needs and little for a bomb. Zero-initialise. */
struct kiln_image_budget {
    uint64_t encoded_bytes, texels;
};

/* Decodes PNG, JPEG (and, where `any_format` is set, BMP, TGA, GIF, PSD) into the builder's texels. `where` begins the sentence
 * ("scene.glb: images[2]"). KILN_BAD_INPUT: not an image, broken, too large. */
int kiln_image_append(struct kiln_builder *builder, struct kiln_image_budget *budget, const unsigned char *bytes, size_t size,
                      bool any_format, const char *where, uint64_t *first, uint32_t *width, uint32_t *height, struct kiln_error *error);

/* Mean of a channel (0: red), 0..1, of a PNG or JPEG. */
int kiln_image_mean(struct kiln_image_budget *budget, const unsigned char *bytes, size_t size, unsigned channel, const char *where, double *mean,
                    struct kiln_error *error);

/* Decodes a lat-long environment (Radiance .hdr, or OpenEXR: first part, R G B or Y, scan lines or tiles) into the builder's
 * environment texels. Negative values become 0 with a note; infinite ones and NaN are refused. */
int kiln_image_append_environment(struct kiln_builder *builder, const unsigned char *bytes, size_t size, const char *where,
                                  uint32_t *width, uint32_t *height, struct kiln_error *error);

#endif
