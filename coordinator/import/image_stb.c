/* JPEG, BMP and TGA, read with stb_image. (libjpeg rounds differently, which would change a bake's results.) */
#include <limits.h>
#include <stb_image.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/import/image_formats.h"

/* A progressive JPEG has about ten scans. Each covers the whole image and may take almost no bytes. */
enum { SCANS_MAX = 64, BASELINE_SCANS_MAX = 4 };

static bool starts(const unsigned char *bytes, size_t size, const char *magic, size_t length)
{
    return size >= length && memcmp(bytes, magic, length) == 0;
}

/* Data source for stb's callbacks. If an image ends too early, stb continues with zeros and reports success; the
 * callbacks notice it. */
struct source {
    const unsigned char *bytes;
    size_t size, at;
    bool overrun; /* stb asked for bytes beyond the end */
};

enum { STB_BUFFER = 128 }; /* size of stb's look-ahead buffer: requests of any other size must be satisfied in full */

static int source_read(void *user, char *data, int size)
{
    struct source *source = user;
    const size_t left = source->size - source->at, count = (size_t)size < left ? (size_t)size : left;
    memcpy(data, source->bytes + source->at, count);
    source->at += count;
    source->overrun |= size > 0 && (count == 0 || (size != STB_BUFFER && count < (size_t)size));
    return (int)count;
}

static void source_skip(void *user, int count)
{
    struct source *source = user;
    if (count < 0) {
        source->at -= (size_t)-count < source->at ? (size_t)-count : source->at;
        return;
    }
    source->overrun |= (size_t)count > source->size - source->at;
    source->at = (size_t)count < source->size - source->at ? source->at + (size_t)count : source->size;
}

static int source_ended(void *user)
{
    const struct source *source = user;
    return source->at == source->size;
}

static const stbi_io_callbacks source_calls = {source_read, source_skip, source_ended};

static bool measure(const unsigned char *bytes, size_t size, uint64_t texels_per_byte, struct kiln_image_shape *shape,
                    char *reason)
{
    int w = 0, h = 0, channels = 0;
    if (size > INT_MAX) {
        (void)snprintf(reason, KILN_REASON_SIZE, "it takes %zu bytes, more than 2 GiB", size);
        return false;
    }
    if (!stbi_info_from_memory(bytes, (int)size, &w, &h, &channels) || w <= 0 || h <= 0) {
        (void)snprintf(reason, KILN_REASON_SIZE, "%s", stbi_failure_reason());
        return false;
    }
    *shape = (struct kiln_image_shape){(uint32_t)w, (uint32_t)h, texels_per_byte * (uint64_t)size};
    return true;
}

static bool decode(const unsigned char *bytes, size_t size, const struct kiln_image_shape *shape, uint8_t *rgba,
                   char reason[KILN_REASON_SIZE])
{
    struct source source = {bytes, size, 0, false};
    int w = 0, h = 0, channels = 0;
    unsigned char *pixels = stbi_load_from_callbacks(&source_calls, &source, &w, &h, &channels, 4);
    const bool whole = pixels != NULL && !source.overrun && w == (int)shape->width && h == (int)shape->height;
    if (whole)
        memcpy(rgba, pixels, 4 * (size_t)w * (size_t)h);
    else
        (void)snprintf(reason, KILN_REASON_SIZE, "%s", source.overrun ? "it is cut off" : stbi_failure_reason());
    stbi_image_free(pixels);
    return whole;
}

/* ---- JPEG ---- */

static bool is_jpeg(const unsigned char *bytes, size_t size) { return starts(bytes, size, "\xff\xd8\xff", 3); }

/* The next marker from *at on, after stuffing, fill bytes and restart markers; 0 at the end of the data. *at is left
 * behind the marker. */
static unsigned next_marker(const unsigned char *bytes, size_t size, size_t *at)
{
    while (*at + 1 < size) {
        const unsigned char *found = memchr(bytes + *at, 0xff, size - *at - 1);
        if (found == NULL)
            return 0;
        *at = (size_t)(found - bytes) + 1;
        const unsigned marker = bytes[*at];
        if (marker == 0xff)
            continue;
        ++*at;
        if (marker != 0 && !(marker >= 0xd0 && marker <= 0xd8) && marker != 0x01)
            return marker;
    }
    return 0;
}

struct scans {
    unsigned count;
    bool progressive;
};

static struct scans count_scans(const unsigned char *bytes, size_t size)
{
    struct scans scans = {0, false};
    size_t at = 2;
    for (unsigned marker; (marker = next_marker(bytes, size, &at)) != 0 && marker != 0xd9;) {
        scans.count += marker == 0xda;
        scans.progressive |= marker == 0xc2;
        const size_t length = size - at < 2 ? 2 : (size_t)bytes[at] << 8 | bytes[at + 1];
        if (length < 2 || length > size - at)
            break;
        at += length;
    }
    return scans;
}

static bool measure_jpeg(const unsigned char *bytes, size_t size, struct kiln_image_shape *shape,
                         char reason[KILN_REASON_SIZE])
{
    if (!measure(bytes, size, 512, shape, reason))
        return false;
    const struct scans scans = count_scans(bytes, size);
    const unsigned most = scans.progressive ? SCANS_MAX : BASELINE_SCANS_MAX;
    if (scans.count > most)
        (void)snprintf(reason, KILN_REASON_SIZE, "it has %u scans, more than %u", scans.count, most);
    return scans.count <= most;
}

/* ---- BMP, TGA ---- */

static bool is_bmp(const unsigned char *bytes, size_t size) { return starts(bytes, size, "BM", 2); }

/* Whether the bytes look like a TGA file. TGA has no signature, but its fields have few valid values, and no other
 * format that stb reads has its second byte. */
static bool is_tga(const unsigned char *bytes, size_t size)
{
    if (size < 18)
        return false;
    const unsigned kind = bytes[2] & 0xf7u, depth = bytes[16];
    return bytes[1] <= 1 && kind >= 1 && kind <= 3 &&
           (depth == 8 || depth == 15 || depth == 16 || depth == 24 || depth == 32);
}

static bool measure_bmp(const unsigned char *bytes, size_t size, struct kiln_image_shape *shape,
                        char reason[KILN_REASON_SIZE])
{
    return measure(bytes, size, 8, shape, reason);
}

static bool measure_tga(const unsigned char *bytes, size_t size, struct kiln_image_shape *shape,
                        char reason[KILN_REASON_SIZE])
{
    return measure(bytes, size, 64, shape, reason);
}

const struct kiln_image_format kiln_format_jpeg = {"JPEG", true, true, is_jpeg, measure_jpeg, decode};
const struct kiln_image_format kiln_format_bmp = {"BMP", false, true, is_bmp, measure_bmp, decode};
const struct kiln_image_format kiln_format_tga = {"TGA", false, true, is_tga, measure_tga, decode};
