/* Reader and writer of OpenEXR files, through OpenEXRCore: one part of scanlines, ZIP compression, half or float
 * channels. Nothing here is collective. */
#ifndef KILN_COORDINATOR_OUTPUT_EXR_H
#define KILN_COORDINATOR_OUTPUT_EXR_H

#include "coordinator/output/image.h"

struct kiln_publish_batch;

enum kiln_exr_kind { KILN_EXR_STRING, KILN_EXR_INTEGER, KILN_EXR_FLOAT };

struct kiln_exr_attribute {
    const char *name;
    enum kiln_exr_kind kind;
    const char *text;
    int32_t integer;
    float number;
};

/* The largest float that rounds to a finite half. */
#define KILN_HALF_MAX 65519.996f

/* Publishes the image. Channels marked `half` are rounded to 16 bits; none of their values may exceed KILN_HALF_MAX
 * (otherwise KILN_BUG, and nothing is written). The complete file is read back and compared with the image before it is
 * renamed. KILN_CANNOT_CREATE, KILN_PERMISSION, KILN_IO, KILN_SYSTEM. The bytes depend only on image and attributes. */
int kiln_exr_write_below(const char *directory, const char *name, const struct kiln_image *image,
                         const struct kiln_exr_attribute *attributes, size_t attribute_count, struct kiln_error *error);
/* The same at a path that a user gave. */
int kiln_exr_write(const char *path, const struct kiln_image *image, const struct kiln_exr_attribute *attributes,
                   size_t attribute_count, struct kiln_error *error);
/* As kiln_exr_write_below, but adds the verified file to the batch, which publishes it later. */
int kiln_exr_put(struct kiln_publish_batch *batch, const char *directory, const char *name,
                 const struct kiln_image *image, const struct kiln_exr_attribute *attributes, size_t attribute_count,
                 struct kiln_error *error);

/* Reads a scanline file: the channels in `wanted` that it has, or all half and float channels if `wanted` is NULL. An
 * image size that the length of the file cannot hold is refused before memory is allocated. Tiled, deep and subsampled
 * files, files of several parts, and anything but a regular file are refused with KILN_BAD_INPUT. Files that somebody
 * else may have written must be read in a confined child (read/reader.h). */
int kiln_exr_read(const char *path, const char *const *wanted, size_t wanted_count, struct kiln_image **image,
                  struct kiln_error *error);
/* Likewise for an open file; `path` is for messages. */
int kiln_exr_read_open(int descriptor, const char *path, const char *const *wanted, size_t wanted_count,
                       struct kiln_image **image, struct kiln_error *error);

#endif
