#include "coordinator/export/page_format.h"

#include <math.h>
#include <string.h>

#include "coordinator/output/exr.h"
#include "coordinator/files/publish.h"
#include "worker/base/memory.h"

static const double HALF_MOST = 65504.0, RGBE_MOST = 0x1p127;

static const struct {
    const char *encoding, *ending;
} formats[] = {[KILN_PAGE_EXR] = {"exr", ".exr"},
               [KILN_PAGE_EXR_HALF] = {"exr", ".exr"},
               [KILN_PAGE_RGBM] = {"rgbm", ".png"},
               [KILN_PAGE_RGBE] = {"rgbe", ".png"},
               [KILN_PAGE_KTX2] = {"ktx2", ".ktx2"}};

const char *kiln_page_encoding(enum kiln_page_format format) { return formats[format].encoding; }
const char *kiln_page_extension(enum kiln_page_format format) { return formats[format].ending; }

/* Checks that all values are from 0 to `most`; reports the first one that is not. *largest receives the largest
 * value. */
static int check_values(const char *path, float *const planes[3], uint32_t width, size_t count, double most,
                        const char *remedy, double *largest, struct kiln_error *error)
{
    *largest = 0.0;
    for (size_t i = 0; i < count; i++)
        for (int c = 0; c < 3; c++) {
            const double value = (double)planes[c][i];
            if (!(value >= 0.0 && value <= most))
                return kiln_fail(error, KILN_BAD_INPUT, "%.512s: %c is %g at texel (%zu, %zu), outside 0 to %g; %s",
                                 path, "RGB"[c], value, i % width, i / width, most, remedy);
            *largest = fmax(*largest, value);
        }
    return KILN_OK;
}

/* ---- EXR ---- */

static int write_exr(const char *directory, const char *name, float *const planes[3], uint32_t width, uint32_t height,
                     bool half, struct kiln_error *error)
{
    static const char *const names[] = {"R", "G", "B"};
    const struct kiln_exr_attribute attributes[] = {
        {.name = "kiln:version", .kind = KILN_EXR_STRING, .text = KILN_VERSION},
        {.name = "kiln:quantity", .kind = KILN_EXR_STRING, .text = "irradiance"}};
    struct kiln_image *image = NULL;
    int status;
    KILN_TRY(kiln_image_create(&image, width, height, names, 3, error));
    for (int c = 0; c < 3; c++) {
        struct kiln_image_channel *channel = kiln_image_find(image, names[c]);
        memcpy(channel->values, planes[c], (size_t)width * height * sizeof(float));
        channel->half = half;
    }
    KILN_TRY(kiln_exr_write_below(directory, name, image, attributes, sizeof attributes / sizeof attributes[0], error));
end:
    kiln_image_destroy(&image);
    return status;
}

/* ---- PNG ---- */

static uint8_t byte_of(double value) { return (uint8_t)fmin(fmax(floor(value + 0.5), 0.0), 255.0); }

/* Encodes a colour as RGBM. The multiplier is the smallest that can hold the largest channel, so that the channels use
 * all their bits. */
static void rgbm(const double rgb[3], double range, uint8_t out[4])
{
    const double most = fmax(rgb[0], fmax(rgb[1], rgb[2])) / range;
    const double multiplier = fmin(fmax(ceil(most * 255.0 - 1e-9), 1.0), 255.0);
    for (int c = 0; c < 3; c++)
        out[c] = byte_of(rgb[c] / range * 255.0 * 255.0 / multiplier);
    out[3] = (uint8_t)multiplier;
}

/* Encodes with the least exponent that holds the largest channel; values below 2^-128 become 0. */
static void rgbe(const double rgb[3], double range, uint8_t out[4])
{
    (void)range;
    int exponent = -128;
    const double most = fmax(rgb[0], fmax(rgb[1], rgb[2]));
    if (most > 0.0)
        (void)frexp(most, &exponent);
    exponent = exponent < -128 ? -128 : exponent > 127 ? 127 : exponent; /* most <= 2^exponent */
    for (int c = 0; c < 3; c++)
        out[c] = byte_of(ldexp(rgb[c], -exponent) * 255.0);
    out[3] = (uint8_t)(exponent + 128);
}

static int write_png(const char *directory, const char *name, float *const planes[3], uint32_t width, uint32_t height,
                     double range, void (*encode)(const double[3], double, uint8_t[4]), struct kiln_error *error)
{
    const size_t count = (size_t)width * height;
    uint8_t *bytes = NULL;
    char *png = NULL;
    size_t size = 0;
    int status;
    KILN_TRY(kiln_allocate(&bytes, count, 4, "a page's bytes", error));
    for (size_t i = 0; i < count; i++) {
        const double rgb[3] = {(double)planes[0][i], (double)planes[1][i], (double)planes[2][i]};
        encode(rgb, range, bytes + 4 * i);
    }
    KILN_TRY(kiln_png_encode_channels(bytes, width, height, 4, &png, &size, error));
    KILN_TRY(kiln_publish_bytes_below(directory, name, png, size, error));
end:
    kiln_free(&png);
    kiln_free(&bytes);
    return status;
}

/* ---- KTX 2.0 (Khronos, "KTX File Format Specification", version 2.0) ---- */

enum {
    KTX_INDEX = 80,
    KTX_LEVEL = 24,
    KTX_DFD = 4 + 24 + 4 * 16,
    KTX_ORIENTATION = 4 + 15 + 3 + 2,
    KTX_WRITER = 4 + 10 + 5 + 1
};

static void put(unsigned char *at, uint64_t value, size_t bytes)
{
    for (size_t i = 0; i < bytes; i++)
        at[i] = (unsigned char)(value >> (8 * i));
}

/* Converts a finite value from 0 to 65504 to half: round to nearest, ties to even. */
static uint16_t half_of(float value)
{
    /* subnormal: in units of the least half; rounding up may reach the first normal number, whose bits follow */
    if (value < 0x1p-14f)
        return (uint16_t)lrintf(value * 0x1p24f);
    int exponent;
    const float fraction = frexpf(value, &exponent); /* 0.5 .. 1 */
    return (uint16_t)(((unsigned)(exponent + 13) << 10) + (unsigned)lrintf(fraction * 2048.0f));
}

/* Writes one channel of the basic data format descriptor: a signed float of 16 bits. */
static void put_sample(unsigned char *at, unsigned offset, unsigned channel)
{
    put(at, offset, 2);
    at[2] = 15;                                       /* bits less 1 */
    at[3] = (unsigned char)(channel | 0x80u | 0x40u); /* float, signed */
    put(at + 8, 0xbf800000u, 4);                      /* -1 */
    put(at + 12, 0x3f800000u, 4);                     /* 1 */
}

/* Writes header, index, data format descriptor and two key-value entries: orientation and writer. */
static void put_head(unsigned char *bytes, uint32_t width, uint32_t height, size_t level, size_t level_size)
{
    static const unsigned char identifier[12] = {0xab, 'K', 'T', 'X', ' ', '2', '0', 0xbb, '\r', '\n', 0x1a, '\n'};
    const size_t descriptor = KTX_INDEX + KTX_LEVEL, words = descriptor + KTX_DFD;
    memcpy(bytes, identifier, sizeof identifier);
    put(bytes + 12, 97, 4); /* VK_FORMAT_R16G16B16A16_SFLOAT */
    put(bytes + 16, 2, 4);  /* bytes of a component */
    put(bytes + 20, width, 4);
    put(bytes + 24, height, 4);
    put(bytes + 36, 1, 4); /* faces */
    put(bytes + 40, 1, 4); /* levels */
    put(bytes + 48, descriptor, 4);
    put(bytes + 52, KTX_DFD, 4);
    put(bytes + 56, words, 4);
    put(bytes + 60, KTX_ORIENTATION + KTX_WRITER, 4);
    put(bytes + KTX_INDEX, level, 8);
    put(bytes + KTX_INDEX + 8, level_size, 8);
    put(bytes + KTX_INDEX + 16, level_size, 8);
    unsigned char *d = bytes + descriptor;
    put(d, KTX_DFD, 4);
    put(d + 8, 2, 2);            /* version */
    put(d + 10, KTX_DFD - 4, 2); /* of this block */
    d[12] = 1;                   /* RGBSDA */
    d[13] = 1;                   /* BT.709 */
    d[14] = 1;                   /* linear */
    d[20] = 8;                   /* bytes of a texel */
    for (unsigned c = 0; c < 4; c++)
        put_sample(d + 28 + 16 * (size_t)c, 16 * c, c == 3 ? 15 : c);
    unsigned char *w = bytes + words;
    put(w, 18, 4);
    memcpy(w + 4, "KTXorientation\0rd", 18);
    w += KTX_ORIENTATION;
    put(w, 15, 4);
    memcpy(w + 4, "KTXwriter\0kiln", 15);
}

static int write_ktx2(const char *directory, const char *name, float *const planes[3], uint32_t width, uint32_t height,
                      struct kiln_error *error)
{
    const size_t count = (size_t)width * height, head = KTX_INDEX + KTX_LEVEL + KTX_DFD + KTX_ORIENTATION + KTX_WRITER,
                 level = (head + 7) / 8 * 8;
    unsigned char *bytes = NULL;
    int status = kiln_allocate(&bytes, level + 8 * count, 1, "a page's bytes", error);
    if (status != KILN_OK)
        return status;
    put_head(bytes, width, height, level, 8 * count);
    for (size_t i = 0; i < count; i++) {
        for (size_t c = 0; c < 3; c++)
            put(bytes + level + 8 * i + 2 * c, half_of(planes[c][i]), 2);
        put(bytes + level + 8 * i + 6, 0x3c00u, 2);
    }
    status = kiln_publish_bytes_below(directory, name, bytes, level + 8 * count, error);
    kiln_free(&bytes);
    return status;
}

/* ---- */

static double most_of(enum kiln_page_format format, double range)
{
    switch (format) {
    case KILN_PAGE_EXR_HALF:
    case KILN_PAGE_KTX2:
        return HALF_MOST;
    case KILN_PAGE_RGBE:
        return RGBE_MOST;
    case KILN_PAGE_RGBM:
        return range > 0.0 ? range : 3.4e38;
    default:
        return 3.5e38;
    }
}

int kiln_page_write(const char *directory, const char *name, enum kiln_page_format format,
                    const struct kiln_image *image, double *range, struct kiln_error *error)
{
    float *planes[3];
    double largest;
    if (!kiln_image_rgb(image, "", planes))
        return kiln_fail(error, KILN_BAD_INPUT, "%.512s: the lightmap has no channels R, G and B", name);
    const char *remedy =
        format == KILN_PAGE_RGBM && *range > 0.0 ? "give a larger --range, or none" : "choose --format exr";
    int status = check_values(name, planes, image->width, (size_t)image->width * image->height, most_of(format, *range),
                              remedy, &largest, error);
    if (status != KILN_OK)
        return status;
    if (format != KILN_PAGE_RGBM)
        *range = 0.0;
    else if (!(*range > 0.0))
        *range = largest > 0.0 ? largest : 1.0;
    switch (format) {
    case KILN_PAGE_RGBM:
        return write_png(directory, name, planes, image->width, image->height, *range, rgbm, error);
    case KILN_PAGE_RGBE:
        return write_png(directory, name, planes, image->width, image->height, 0.0, rgbe, error);
    case KILN_PAGE_KTX2:
        return write_ktx2(directory, name, planes, image->width, image->height, error);
    default:
        return write_exr(directory, name, planes, image->width, image->height, format == KILN_PAGE_EXR_HALF, error);
    }
}
