/* The image decoders, one per file. Private to coordinator/import/image*.c.
 *
 * A header's size is checked against the number of texels that the file's bytes can hold at most:
 *   PNG       deflate makes 1,032 bytes of one; a texel takes 1 to 64 bits
 *   JPEG      a block of 8 x 8 texels takes at least one bit: 512 texels a byte
 *   BMP       one bit a texel: 8 texels a byte
 *   TGA       a run of 128 texels takes two bytes: 64 texels a byte
 *   Radiance  a run of 127 texels takes two bytes in each of four channels, and a row 4 bytes more
 *   OpenEXR   depends on the compression: see image_exr.c */
#ifndef KILN_COORDINATOR_IMPORT_IMAGE_FORMATS_H
#define KILN_COORDINATOR_IMPORT_IMAGE_FORMATS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { KILN_REASON_SIZE = 160 };

struct kiln_image_shape {
    uint32_t width, height;
    uint64_t reach; /* texels that the file's bytes can hold at most */
};

/* A texture format. When a function returns false, it writes why to `reason`, as words that fit into brackets. */
struct kiln_image_format {
    const char *name;
    bool everywhere; /* allowed in glTF too, not only in OBJ */
    bool by_stb;
    bool (*matches)(const unsigned char *bytes, size_t size);
    /* Reads the headers, and checks what can be checked without decoding. */
    bool (*measure)(const unsigned char *bytes, size_t size, struct kiln_image_shape *shape,
                    char reason[KILN_REASON_SIZE]);
    /* Decodes to 8-bit RGBA, top row first; `rgba` has room for the shape. */
    bool (*decode)(const unsigned char *bytes, size_t size, const struct kiln_image_shape *shape, uint8_t *rgba,
                   char reason[KILN_REASON_SIZE]);
};

extern const struct kiln_image_format kiln_format_png, kiln_format_jpeg, kiln_format_bmp, kiln_format_tga;

struct kiln_error;

/* Whether the primaries red, green, blue and white (x and y of each) are those of sRGB, within the precision of files.
 */
bool kiln_primaries_are_srgb(const double primaries[8]);
/* Memory that this process may use, bytes: its limit of address space, or KILN_IMAGE_MEMORY if it has none. */
uint64_t kiln_image_memory(void);

/* Header of a Radiance image. The stored values are radiance x exposure x correction; Radiance's programs have scaled
 * the pixels by these two. */
struct kiln_radiance_header {
    uint32_t width, height;
    size_t rows;          /* offset of the rows */
    double divisor[3];    /* exposure x correction of each channel: the products of all such lines */
    bool other_primaries; /* PRIMARIES are neither those of Radiance nor those of sRGB */
};

/* Radiance decoder. kiln_radiance_measure reads the header; kiln_radiance_decode decodes all rows to linear RGB,
 * divided by the header's divisors; with `rgb` NULL it only checks the rows, and needs no memory. `where` begins error
 * sentences. */
int kiln_radiance_measure(const unsigned char *bytes, size_t size, const char *where,
                          struct kiln_radiance_header *header, struct kiln_error *error);
int kiln_radiance_decode(const unsigned char *bytes, size_t size, const char *where,
                         const struct kiln_radiance_header *header, float *rgb, struct kiln_error *error);

/* OpenEXR decoder: reads the size of the first part, then its texels. Close with kiln_exr_close, also after a failure.
 */
struct kiln_exr;
int kiln_exr_open(struct kiln_exr **exr, const unsigned char *bytes, size_t size, const char *where,
                  struct kiln_error *error);
/* Whether the file states primaries other than those of sRGB. */
bool kiln_exr_other_primaries(const struct kiln_exr *exr);
void kiln_exr_size(const struct kiln_exr *exr, int64_t *width, int64_t *height);
int kiln_exr_decode(struct kiln_exr *exr, float *rgb, struct kiln_error *error);
void kiln_exr_close(struct kiln_exr **exr);

#endif
