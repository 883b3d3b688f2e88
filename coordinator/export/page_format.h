/* Writes a page of lightmaps as a file: linear RGB irradiance, top row v = 0, in encodings that engines read. Nothing
 * is clamped: a value that an encoding cannot hold is an error that names it.
 *
 *   exr       OpenEXR, float: exact
 *   exr-half  OpenEXR, half: 11 bits, up to 65504
 *   rgbm      PNG, 8 bits, no colour profile: E = RGB x A x range, all four from 0 to 1
 *   rgbe      PNG, 8 bits: E = RGB x 2^(255 A - 128), with RGB and A from 0 to 1
 *   ktx2      KTX 2.0, VK_FORMAT_R16G16B16A16_SFLOAT (A = 1), one level, not compressed: Debian 12 has no library that
 *             encodes BC6H */
#ifndef KILN_COORDINATOR_EXPORT_PAGE_FORMAT_H
#define KILN_COORDINATOR_EXPORT_PAGE_FORMAT_H

#include "coordinator/job/choices.h"
#include "coordinator/output/image.h"

/* The encoding's name in links ("exr" for both EXRs), and the extension of its files (".exr"). */
const char *kiln_page_encoding(enum kiln_page_format format);
const char *kiln_page_extension(enum kiln_page_format format);

/* Publishes the channels R, G and B of `image` as the file `name`. *range, for rgbm: the value that 1 x 1 stands for; 0
 * asks for the image's largest value, which is then returned in it (1 if all is black). Other formats set it to 0.
 * KILN_BAD_INPUT when a value is not finite, is negative, or exceeds what the format or the range holds. */
int kiln_page_write(const char *directory, const char *name, enum kiln_page_format format,
                    const struct kiln_image *image, double *range, struct kiln_error *error);

#endif
