/* OpenEXR files in strips: different processes can compress the strips of an image, and one of them writes the file.
 * The bytes are the same as those of kiln_exr_write.
 *
 * A strip is a compression unit of the file: KILN_EXR_ROWS rows of all channels; the last may have fewer. Packing a
 * strip includes decompressing it and comparing the values. The file is published only if every strip reads back from
 * disk with the hash that it was packed with. Nothing here is collective. */
#ifndef KILN_COORDINATOR_OUTPUT_EXR_STRIPS_H
#define KILN_COORDINATOR_OUTPUT_EXR_STRIPS_H

#include "coordinator/output/exr.h"

enum { KILN_EXR_ROWS = 16, KILN_EXR_CHANNELS = 32 }; /* channels: of an image that is packed in strips, at most */

struct kiln_exr_strip {
    uint8_t *bytes; /* from kiln_allocate */
    size_t size;
    uint64_t hash;   /* XXH3 of the bytes */
    uint64_t values; /* XXH3 of the values, from kiln_exr_strip_values */
};

/* XXH3 of the values of all channels in the strip that begins at row `y`. */
uint64_t kiln_exr_strip_values(const struct kiln_image *image, uint32_t y);

/* Packs the strip that begins at row `y`, a multiple of KILN_EXR_ROWS, and checks it. The result does not depend on
 * other rows, which the image need not have. Thread-safe. KILN_IO if it does not decompress to its values; KILN_SYSTEM.
 */
int kiln_exr_strip_pack(const struct kiln_image *image, uint32_t y, struct kiln_exr_strip *strip,
                        struct kiln_error *error);

struct kiln_exr_file;

/* Begins the file DIRECTORY/NAME (publish.h) with the size and channels of the image and the attributes. The values are
 * only checked, as kiln_exr_write does and with the same statuses. The image is borrowed until the file is destroyed.
 */
int kiln_exr_file_create(struct kiln_exr_file **file, const char *directory, const char *name,
                         const struct kiln_image *image, const struct kiln_exr_attribute *attributes,
                         size_t attribute_count, struct kiln_error *error);

/* Appends the next strip, from top to bottom. */
int kiln_exr_file_append(struct kiln_exr_file *file, const void *bytes, size_t size, uint64_t hash,
                         struct kiln_error *error);

/* After the last strip: reads the file back and publishes it. */
int kiln_exr_file_publish(struct kiln_exr_file *file, struct kiln_error *error);

/* Closes the file and removes it if it has not been published. */
void kiln_exr_file_destroy(struct kiln_exr_file **file);

#endif
