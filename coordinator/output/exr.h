/* OpenEXR files through OpenEXRCore: one scanline part, ZIP, half or float channels. Nothing here is collective. */
#ifndef KILN_COORDINATOR_OUTPUT_EXR_H
#define KILN_COORDINATOR_OUTPUT_EXR_H

#include "coordinator/output/image.h"

enum kiln_exr_kind { KILN_EXR_STRING, KILN_EXR_INTEGER, KILN_EXR_FLOAT };

struct kiln_exr_attribute {
    const char *name;
    enum kiln_exr_kind kind;
    const char *text;
    int32_t integer;
    float number;
};

/* The largest float that half precision holds after rounding to nearest; above it a half would be infinite. */
#define KILN_HALF_MAX 65519.996f

/* Publishes the image. A channel marked `half` is rounded to 16 bits: the caller has seen to it that nothing exceeds
 * KILN_HALF_MAX (KILN_BUG otherwise, nothing written). The file is read back whole and compared with the image before
 * it gets its name. KILN_CANNOT_CREATE, KILN_PERMISSION, KILN_IO, KILN_SYSTEM. Same image and attributes, same bytes.
 */
int kiln_exr_write_below(const char *directory, const char *name, const struct kiln_image *image,
                         const struct kiln_exr_attribute *attributes, size_t attribute_count, struct kiln_error *error);
/* The same at a path that a user gave. */
int kiln_exr_write(const char *path, const struct kiln_image *image, const struct kiln_exr_attribute *attributes,
                   size_t attribute_count, struct kiln_error *error);

/* Reads a scanline file: the channels named in `wanted` that it has (all half and float channels when `wanted` is
 * NULL). Sizes that the file's own length cannot hold are refused before anything is allocated. Tiled, deep and
 * subsampled files, those of several parts and what is no plain file are refused with KILN_BAD_INPUT. Files that
 * somebody else may have written are read in a confined child (read/reader.h). */
int kiln_exr_read(const char *path, const char *const *wanted, size_t wanted_count, struct kiln_image **image,
                  struct kiln_error *error);
/* The same of an open file; `path` is for sentences. */
int kiln_exr_read_open(int descriptor, const char *path, const char *const *wanted, size_t wanted_count,
                       struct kiln_image **image, struct kiln_error *error);

#endif
