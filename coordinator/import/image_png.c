/* PNG, read with libpng. */
#include <png.h>
#include <setjmp.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/import/image_formats.h"

static const uint64_t deflate_most = 1032; /* bytes that one byte of deflated data can become, at most */
enum { HEADER_SIZE = 33, SIGNATURE_SIZE = 8 };

static bool matches(const unsigned char *bytes, size_t size)
{
    return size >= SIGNATURE_SIZE && memcmp(bytes, "\x89PNG\r\n\x1a\n", SIGNATURE_SIZE) == 0;
}

static uint32_t big32(const unsigned char *bytes)
{
    return (uint32_t)bytes[0] << 24 | (uint32_t)bytes[1] << 16 | (uint32_t)bytes[2] << 8 | (uint32_t)bytes[3];
}

static unsigned channels_of(unsigned color_type)
{
    static const unsigned char channels[] = {1, 0, 3, 1, 2, 0, 4}; /* grey, -, RGB, palette, grey and alpha, -, RGBA */
    return color_type < sizeof channels ? channels[color_type] : 0;
}

static bool measure(const unsigned char *bytes, size_t size, struct kiln_image_shape *shape,
                    char reason[KILN_REASON_SIZE])
{
    if (size < HEADER_SIZE || memcmp(bytes + 12, "IHDR", 4) != 0) {
        (void)snprintf(reason, KILN_REASON_SIZE, "its header is cut off");
        return false;
    }
    const uint64_t bits = (uint64_t)bytes[24] * channels_of(bytes[25]);
    shape->width = big32(bytes + 16);
    shape->height = big32(bytes + 20);
    if (shape->width == 0 || shape->height == 0 || bits == 0 || bytes[24] > 16) {
        (void)snprintf(reason, KILN_REASON_SIZE, "its header says %u x %u texels of %u bits, colour type %u",
                       shape->width, shape->height, bytes[24], bytes[25]);
        return false;
    }
    shape->reach = 8 * deflate_most * (uint64_t)size / bits;
    return true;
}

struct job {
    const unsigned char *bytes;
    size_t size, at;
    char *reason;
};

static void on_error(png_structp png, png_const_charp message)
{
    const struct job *job = png_get_error_ptr(png);
    (void)snprintf(job->reason, KILN_REASON_SIZE, "%s", message);
    png_longjmp(png, 1);
}

/* Ignores libpng's warnings: what it only warns of changes no texel. */
static void on_warning(png_structp png, png_const_charp message)
{
    (void)png;
    (void)message;
}

static void read_bytes(png_structp png, png_bytep target, size_t count)
{
    struct job *job = png_get_io_ptr(png);
    if (count > job->size - job->at)
        png_error(png, "it is cut off");
    memcpy(target, job->bytes + job->at, count);
    job->at += count;
}

/* Asks libpng for 8-bit RGBA; of 16 bits the upper 8 are kept. No colour management: the scene says whether texels are
 * sRGB or linear. */
static void ask_for_rgba(png_structp png)
{
    png_set_expand(png);
    png_set_strip_16(png);
    png_set_gray_to_rgb(png);
    png_set_add_alpha(png, 0xff, PNG_FILLER_AFTER);
}

static void read_rows(png_structp png, png_infop info, const struct kiln_image_shape *shape, uint8_t *rgba)
{
    png_read_info(png, info);
    ask_for_rgba(png);
    const int passes = png_set_interlace_handling(png);
    png_read_update_info(png, info);
    if (png_get_rowbytes(png, info) != 4 * (size_t)shape->width || png_get_image_height(png, info) != shape->height)
        png_error(png, "its header changed while it was read");
    for (int pass = 0; pass < passes; pass++)
        for (size_t y = 0; y < shape->height; y++)
            png_read_row(png, rgba + y * 4 * shape->width, NULL);
    png_read_end(png, NULL);
}

static bool decode(const unsigned char *bytes, size_t size, const struct kiln_image_shape *shape, uint8_t *rgba,
                   char reason[KILN_REASON_SIZE])
{
    struct job job = {bytes, size, 0, reason};
    (void)snprintf(reason, KILN_REASON_SIZE, "out of memory");
    png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, &job, on_error, on_warning);
    png_infop info = png == NULL ? NULL : png_create_info_struct(png);
    volatile bool whole = false;
    if (info != NULL && setjmp(png_jmpbuf(png)) == 0) {
        png_set_read_fn(png, &job, read_bytes);
        png_set_user_limits(png, shape->width, shape->height);
        /* texts, profiles and similar chunks are not unpacked */
        png_set_keep_unknown_chunks(png, PNG_HANDLE_CHUNK_NEVER, NULL, -1);
        read_rows(png, info, shape, rgba);
        whole = true;
    }
    png_destroy_read_struct(&png, &info, NULL);
    return whole;
}

const struct kiln_image_format kiln_format_png = {"PNG", true, false, matches, measure, decode};
