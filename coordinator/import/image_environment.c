/* Environment images: limits, and checks of their values. */
#include <math.h>
#include <string.h>

#include "coordinator/import/image.h"
#include "coordinator/import/image_formats.h"
#include "coordinator/import/numbers.h"

/* Checks an environment image's size. It may have as many texels as its bytes in the file allow or, if that is more,
 * as fit into an eighth of the memory. */
static int judge(int64_t w, int64_t h, size_t size, const char *where, struct kiln_error *error)
{
    const uint64_t earned = size > KILN_ENVIRONMENT_TEXELS_MAX
                                ? KILN_ENVIRONMENT_TEXELS_MAX
                                : KILN_ENVIRONMENT_TEXELS_FREE + KILN_ENVIRONMENT_TEXELS_PER_BYTE * size;
    const uint64_t most = earned < KILN_ENVIRONMENT_TEXELS_MAX ? earned : KILN_ENVIRONMENT_TEXELS_MAX,
                   room = kiln_image_memory() / 8 / KILN_ENVIRONMENT_BYTES_PER_TEXEL;
    if (w <= 0 || h <= 0 || w > KILN_ENVIRONMENT_SIDE_MAX || h > KILN_ENVIRONMENT_SIDE_MAX ||
        ((uint64_t)(w * h) > most && (uint64_t)(w * h) > room))
        return kiln_fail(
            error, KILN_BAD_INPUT,
            "%s is %lld x %lld pixels; an environment of %zu bytes may have up to %llu pixels, and no side above %d",
            where, (long long)w, (long long)h, size, (unsigned long long)(most > room ? most : room),
            KILN_ENVIRONMENT_SIDE_MAX);
    return KILN_OK;
}

static int append_texels(struct kiln_builder *builder, int64_t w, int64_t h, float **texels, struct kiln_error *error)
{
    size_t first = 0;
    const int status =
        kiln_builder_append(builder, KILN_SECTION_ENVIRONMENT_TEXELS, NULL, 3 * (size_t)w * (size_t)h, &first, error);
    if (status == KILN_OK)
        *texels = KILN_BUILDER_DATA(builder, float, KILN_SECTION_ENVIRONMENT_TEXELS) + first;
    return status;
}

static int note_primaries(struct kiln_builder *builder, const char *where, bool other, struct kiln_error *error)
{
    return !other ? KILN_OK
                  : kiln_builder_note(builder, KILN_NOTE_REPEATED, error,
                                      "%s: its primaries are not those of sRGB; its colours are taken as if they were",
                                      where);
}

static int note_header(struct kiln_builder *builder, const char *where, const struct kiln_radiance_header *header,
                       struct kiln_error *error)
{
    const double *d = header->divisor;
    int status = KILN_OK;
    if (d[0] != 1.0 || d[1] != 1.0 || d[2] != 1.0)
        status = kiln_builder_note(builder, KILN_NOTE_REPEATED, error,
                                   "%s: its header says that the pixels were multiplied by %.6g, %.6g and %.6g "
                                   "(EXPOSURE, COLORCORR); they are divided by it",
                                   where, d[0], d[1], d[2]);
    return status == KILN_OK ? note_primaries(builder, where, header->other_primaries, error) : status;
}

static int append_radiance(struct kiln_builder *builder, const unsigned char *bytes, size_t size, const char *where,
                           uint32_t *width, uint32_t *height, struct kiln_error *error)
{
    struct kiln_radiance_header header;
    float *texels = NULL;
    int status;
    KILN_TRY(kiln_radiance_measure(bytes, size, where, &header, error));
    KILN_TRY(judge(header.width, header.height, size, where, error));
    KILN_TRY(kiln_radiance_decode(bytes, size, where, &header, NULL, error));
    KILN_TRY(append_texels(builder, header.width, header.height, &texels, error));
    KILN_TRY(kiln_radiance_decode(bytes, size, where, &header, texels, error));
end:
    *width = header.width;
    *height = header.height;
    return status == KILN_OK ? note_header(builder, where, &header, error) : status;
}

static int append_exr(struct kiln_builder *builder, const unsigned char *bytes, size_t size, const char *where,
                      uint32_t *width, uint32_t *height, struct kiln_error *error)
{
    struct kiln_exr *exr = NULL;
    int64_t w = 0, h = 0;
    float *texels = NULL;
    int status;
    KILN_TRY(kiln_exr_open(&exr, bytes, size, where, error));
    kiln_exr_size(exr, &w, &h);
    KILN_TRY(judge(w, h, size, where, error));
    KILN_TRY(kiln_exr_decode(exr, NULL, error));
    KILN_TRY(append_texels(builder, w, h, &texels, error));
    KILN_TRY(kiln_exr_decode(exr, texels, error));
    KILN_TRY(note_primaries(builder, where, kiln_exr_other_primaries(exr), error));
end:
    kiln_exr_close(&exr);
    *width = (uint32_t)w;
    *height = (uint32_t)h;
    return status;
}

/* Checks the values and sets negative ones to 0. */
static int check_values(struct kiln_builder *builder, float *texels, uint32_t width, uint32_t height, const char *where,
                        struct kiln_error *error)
{
    size_t negative = 0;
    for (size_t i = 0; i < 3 * (size_t)width * height; i++) {
        const size_t x = i / 3 % width, y = i / 3 / width;
        if (!isfinite(texels[i]))
            return kiln_fail(error, KILN_BAD_INPUT,
                             "%s: pixel (%zu, %zu) is infinite or not a number; repair the image", where, x, y);
        if (texels[i] > 0.0f && !kiln_number_fits(KILN_NUMBER_LIGHT, (double)texels[i]))
            return kiln_fail(error, KILN_BAD_INPUT, "%s: pixel (%zu, %zu) is %g, more than %g; repair the image", where,
                             x, y, (double)texels[i], KILN_LIGHT_MOST);
        if (texels[i] < 0.0f) {
            texels[i] = 0.0f;
            negative++;
        }
    }
    return negative == 0
               ? KILN_OK
               : kiln_builder_note(builder, 1, error, "%s: %zu negative values were set to 0", where, negative);
}

int kiln_image_append_environment(struct kiln_builder *builder, const unsigned char *bytes, size_t size,
                                  const char *where, uint32_t *width, uint32_t *height, struct kiln_error *error)
{
    int status;
    if (size >= 4 && memcmp(bytes, "\x76\x2f\x31\x01", 4) == 0)
        status = append_exr(builder, bytes, size, where, width, height, error);
    else if (size >= 10 && (memcmp(bytes, "#?RADIANCE", 10) == 0 || memcmp(bytes, "#?RGBE", 6) == 0))
        status = append_radiance(builder, bytes, size, where, width, height, error);
    else
        status =
            kiln_fail(error, KILN_BAD_INPUT, "%s is neither Radiance (.hdr) nor OpenEXR (.exr); convert it", where);
    if (status != KILN_OK)
        return status;
    return check_values(builder, KILN_BUILDER_DATA(builder, float, KILN_SECTION_ENVIRONMENT_TEXELS), *width, *height,
                        where, error);
}
