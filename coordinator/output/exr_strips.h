/* OpenEXR files whose strips are packed apart, by whoever has time, and written in order by one: the same bytes as
 * kiln_exr_write makes.
 *
 * A strip is what the file packs at a time, KILN_EXR_ROWS rows of all channels (the last may have fewer). Whoever packs
 * one unpacks it again and compares it with its values; the file is published only when every strip reads back from
 * disk as the bytes whose hash came with it. Nothing here is collective. */
#ifndef KILN_COORDINATOR_OUTPUT_EXR_STRIPS_H
#define KILN_COORDINATOR_OUTPUT_EXR_STRIPS_H

#include "coordinator/output/exr.h"

enum { KILN_EXR_ROWS = 16, KILN_EXR_CHANNELS = 12 }; /* channels: of an image that is packed in strips, at most */

struct kiln_exr_strip {
    uint8_t *bytes; /* from kiln_allocate */
    size_t size;
    uint64_t hash;   /* XXH3 of the bytes */
    uint64_t values; /* XXH3 of what was packed: kiln_exr_strip_values of the rows */
};

/* XXH3 of all channels' values in the strip that begins at row `y`. */
uint64_t kiln_exr_strip_values(const struct kiln_image *image, uint32_t y);

/* Packs the strip that begins at row `y`, a multiple of KILN_EXR_ROWS, and checks it. The image may as well have no
 * other rows: the result is the same. Thread-safe. KILN_IO when it does not unpack to what it was, KILN_SYSTEM. */
int kiln_exr_strip_pack(const struct kiln_image *image, uint32_t y, struct kiln_exr_strip *strip,
                        struct kiln_error *error);

struct kiln_exr_file;

/* Begins the file DIRECTORY/NAME (publish.h) with the image's size, channels and the attributes; its values are only
 * looked at to refuse what kiln_exr_write refuses, and with the same statuses. The image is borrowed until the file is
 * destroyed. */
int kiln_exr_file_create(struct kiln_exr_file **file, const char *directory, const char *name,
                         const struct kiln_image *image, const struct kiln_exr_attribute *attributes,
                         size_t attribute_count, struct kiln_error *error);

/* The next strip from the top. */
int kiln_exr_file_append(struct kiln_exr_file *file, const void *bytes, size_t size, uint64_t hash,
                         struct kiln_error *error);

/* After the last strip: reads the file back, gives it its name. */
int kiln_exr_file_publish(struct kiln_exr_file *file, struct kiln_error *error);

/* Leaves nothing behind of a file that was not published. */
void kiln_exr_file_destroy(struct kiln_exr_file **file);

#endif
