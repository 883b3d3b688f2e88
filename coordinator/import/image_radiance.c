/* Radiance RGBE images, as Radiance's own ra_* programs and all current programs write them: top row first, each row
 * flat or with the run lengths of 1991. This is kiln's own decoder because stb_image neither notices the end of the
 * file nor checks run lengths before it allocates. Values are mantissa x 2^(exponent - 136), divided by the header's
 * EXPOSURE and COLORCORR ("multiply to get original units": Radiance's picture format, refer to its filefmts). */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/import/image_formats.h"
#include "worker/base/status.h"

enum { LINE_MAX_BYTES = 4096, RUN_WIDTH_MIN = 8, RUN_WIDTH_MAX = 32767, RUN_MOST = 127 };

static int broken(const char *where, struct kiln_error *error, const char *reason)
{
    return kiln_fail(error, KILN_BAD_INPUT, "%s is a broken image (%s); save it again", where, reason);
}

/* ---- header ---- */

/* The line that begins at *at, without its line feed; NULL if no line feed follows. */
static const char *next_line(const unsigned char *bytes, size_t size, size_t *at, size_t *length)
{
    const size_t left = size - *at;
    const unsigned char *line = bytes + *at, *end = memchr(line, '\n', left < LINE_MAX_BYTES ? left : LINE_MAX_BYTES);
    if (end == NULL)
        return NULL;
    *length = (size_t)(end - line);
    *at += *length + 1;
    return (const char *)line;
}

static bool is(const char *line, size_t length, const char *text)
{
    return length == strlen(text) && memcmp(line, text, length) == 0;
}

/* Parses a number of at most 2^31; false if there are no digits. */
static bool number(const char **at, const char *end, uint32_t *value)
{
    const char *first = *at;
    for (*value = 0; *at < end && **at >= '0' && **at <= '9' && *value < 100000000; ++*at)
        *value = 10 * *value + (uint32_t)(**at - '0');
    return *at > first;
}

static bool word(const char **at, const char *end, const char *text)
{
    const size_t length = strlen(text);
    if ((size_t)(end - *at) < length || memcmp(*at, text, length) != 0)
        return false;
    *at += length;
    return true;
}

/* Parses "-Y 4 +X 8": rows from the top, each from the left. */
static bool parse_resolution(const char *line, size_t length, uint32_t *width, uint32_t *height)
{
    const char *at = line, *end = line + length;
    return word(&at, end, "-Y ") && number(&at, end, height) && word(&at, end, " +X ") && number(&at, end, width) &&
           at == end;
}

/* Parses `count` numbers after a keyword such as "EXPOSURE=". Returns false if the line has another keyword. */
static bool numbers_of(const char *line, size_t length, const char *keyword, size_t count, double *values, bool *sound)
{
    char text[256], *at = text;
    const size_t skipped = strlen(keyword);
    if (length < skipped || memcmp(line, keyword, skipped) != 0)
        return false;
    (void)snprintf(text, sizeof text, "%.*s", (int)(length - skipped < 255 ? length - skipped : 255), line + skipped);
    *sound = true;
    for (size_t i = 0; i < count && *sound; i++) {
        char *end = NULL;
        values[i] = strtod(at, &end);
        *sound = end != at && isfinite(values[i]);
        at = end;
    }
    *sound = *sound && at[strspn(at, " \t\r")] == '\0';
    return true;
}

static bool near_all(const double *a, const double *b, size_t count)
{
    for (size_t i = 0; i < count; i++)
        if (!(fabs(a[i] - b[i]) < 0.005))
            return false;
    return true;
}

bool kiln_primaries_are_srgb(const double primaries[8])
{
    static const double srgb[8] = {0.640, 0.330, 0.300, 0.600, 0.150, 0.060, 0.3127, 0.3290};
    return near_all(primaries, srgb, 8);
}

/* Evaluates a header line about changes of the pixels. Returns NULL, or the reason for refusing the file. */
static const char *take_line(const char *line, size_t length, struct kiln_radiance_header *header)
{
    static const double own[8] = {0.640, 0.330, 0.290, 0.600, 0.150, 0.060, 0.333, 0.333}; /* Radiance's */
    double values[8] = {0.0};
    bool sound = false;
    const bool exposure = numbers_of(line, length, "EXPOSURE=", 1, values, &sound);
    if (exposure || numbers_of(line, length, "COLORCORR=", 3, values, &sound)) {
        for (int k = 0; k < 3; k++) {
            const double value = values[exposure ? 0 : k];
            header->divisor[k] *= value;
            sound = sound && value > 0.0 && header->divisor[k] > 1e-30 && header->divisor[k] < 1e30;
        }
        return sound ? NULL : exposure ? "its EXPOSURE is no positive number" : "its COLORCORR is not three of them";
    }
    if (numbers_of(line, length, "PRIMARIES=", 8, values, &sound))
        header->other_primaries = !sound || !(near_all(values, own, 8) || kiln_primaries_are_srgb(values));
    return NULL;
}

int kiln_radiance_measure(const unsigned char *bytes, size_t size, const char *where,
                          struct kiln_radiance_header *header, struct kiln_error *error)
{
    size_t at = 0, length;
    bool rgbe = false;
    const char *line = next_line(bytes, size, &at, &length), *fault = NULL;
    *header = (struct kiln_radiance_header){.divisor = {1.0, 1.0, 1.0}};
    while (line != NULL && fault == NULL && (line = next_line(bytes, size, &at, &length)) != NULL && length > 0) {
        rgbe |= is(line, length, "FORMAT=32-bit_rle_rgbe");
        fault = take_line(line, length, header);
        if (is(line, length, "FORMAT=32-bit_rle_xyze"))
            return kiln_fail(error, KILN_BAD_INPUT, "%s is a Radiance image in XYZ; convert it to RGB (ra_xyze -r)",
                             where);
    }
    if (fault != NULL)
        return broken(where, error, fault);
    line = line == NULL ? NULL : next_line(bytes, size, &at, &length);
    if (line == NULL || !rgbe)
        return kiln_fail(error, KILN_BAD_INPUT, "%s cannot be read as a Radiance image (%s); give an .hdr or .exr",
                         where, line == NULL ? "its header has no end" : "it has no line FORMAT=32-bit_rle_rgbe");
    if (!parse_resolution(line, length, &header->width, &header->height))
        return kiln_fail(error, KILN_BAD_INPUT,
                         "%s cannot be read as a Radiance image (its size is given as '%.*s', not as -Y HEIGHT +X "
                         "WIDTH); turn it upright and save it again",
                         where, length < 40 ? (int)length : 40, line);
    header->rows = at;
    return KILN_OK;
}

/* ---- rows ---- */

/* The bytes not read yet. */
struct stream {
    const unsigned char *at, *end;
};

static size_t left_of(const struct stream *s) { return (size_t)(s->end - s->at); }

static bool has_runs(const struct stream *s, uint32_t width)
{
    return width >= RUN_WIDTH_MIN && width <= RUN_WIDTH_MAX && left_of(s) >= 4 && s->at[0] == 2 && s->at[1] == 2 &&
           s->at[2] < 128;
}

/* Reads one channel of a row from runs (128 + length, value) and dumps (length, values). With target NULL, only checks
 * them. */
static const char *read_channel(struct stream *s, uint32_t width, unsigned char *target)
{
    for (uint32_t x = 0; x < width;) {
        if (left_of(s) < 2)
            return "it is cut off";
        const bool run = s->at[0] > 128;
        const uint32_t count = run ? s->at[0] - 128u : s->at[0];
        const size_t stored = run ? 1 : count;
        s->at++;
        if (count == 0 || count > width - x)
            return "a run length leads out of its row";
        if (left_of(s) < stored)
            return "it is cut off";
        if (target != NULL && run)
            memset(target + x, s->at[0], count);
        else if (target != NULL)
            memcpy(target + x, s->at, count);
        s->at += stored;
        x += count;
    }
    return NULL;
}

static const char *read_runs(struct stream *s, uint32_t width, unsigned char *planes)
{
    const uint32_t said = (uint32_t)s->at[2] << 8 | s->at[3];
    if (said != width)
        return "a row is not as long as the image is wide";
    s->at += 4;
    for (size_t c = 0; c < 4; c++) {
        const char *reason = read_channel(s, width, planes == NULL ? NULL : planes + c * width);
        if (reason != NULL)
            return reason;
    }
    return NULL;
}

static void convert(const unsigned char *pixel, size_t stride, float rgb[3])
{
    const unsigned exponent = pixel[3 * stride];
    const float factor = exponent == 0 ? 0.0f : ldexpf(1.0f, (int)exponent - 136);
    for (size_t c = 0; c < 3; c++)
        rgb[c] = (float)pixel[c * stride] * factor;
}

/* Reads a row of four bytes a pixel. In files from before 1991, a pixel (1, 1, 1, n) repeats the one before it. */
static const char *read_flat(struct stream *s, uint32_t width, float *rgb)
{
    if (left_of(s) / 4 < width)
        return "it is cut off";
    for (uint32_t x = 0; x < width; x++, s->at += 4) {
        if (s->at[0] == 1 && s->at[1] == 1 && s->at[2] == 1)
            return "it has run lengths of before 1991, which kiln does not read";
        if (rgb != NULL)
            convert(s->at, 1, rgb + 3 * (size_t)x);
    }
    return NULL;
}

/* Reads a row. With `rgb` NULL it only checks it. */
static const char *read_row(struct stream *s, uint32_t width, float *rgb)
{
    unsigned char planes[4 * RUN_WIDTH_MAX];
    if (!has_runs(s, width))
        return read_flat(s, width, rgb);
    const char *reason = read_runs(s, width, rgb == NULL ? NULL : planes);
    for (uint32_t x = 0; reason == NULL && rgb != NULL && x < width; x++)
        convert(planes + x, width, rgb + 3 * (size_t)x);
    return reason;
}

int kiln_radiance_decode(const unsigned char *bytes, size_t size, const char *where,
                         const struct kiln_radiance_header *header, float *rgb, struct kiln_error *error)
{
    struct stream s = {bytes + header->rows, bytes + size};
    const size_t values = 3 * (size_t)header->width;
    for (size_t y = 0; y < header->height; y++) {
        float *row = rgb == NULL ? NULL : rgb + y * values;
        const char *reason = read_row(&s, header->width, row);
        if (reason != NULL)
            return broken(where, error, reason);
        for (size_t i = 0; i < values && row != NULL; i++)
            if (header->divisor[i % 3] != 1.0)
                row[i] = (float)((double)row[i] / header->divisor[i % 3]);
    }
    return KILN_OK;
}
