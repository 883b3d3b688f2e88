#include "coordinator/import/image.h"

#include <string.h>
#include <sys/resource.h>
#include <xxhash.h>

#include "coordinator/import/image_formats.h"
#include "worker/base/memory.h"

/* ---- formats ---- */

static const struct kiln_image_format *const formats[] = {&kiln_format_png, &kiln_format_jpeg, &kiln_format_bmp,
                                                          &kiln_format_tga};

static const struct kiln_image_format *format_of(const struct kiln_image_bytes *bytes)
{
    for (size_t i = 0; i < sizeof formats / sizeof formats[0]; i++)
        if ((bytes->any_format || formats[i]->everywhere) && formats[i]->matches(bytes->data, bytes->size))
            return formats[i];
    return NULL;
}

static bool starts(const struct kiln_image_bytes *bytes, const char *magic, size_t length)
{
    return bytes->size >= length && memcmp(bytes->data, magic, length) == 0;
}

static const char *describe_format(const struct kiln_image_bytes *bytes)
{
    static const struct {
        const char *magic, *kind;
        size_t length;
    } known[] = {{"\xabKTX 20\xbb", "a KTX2 (Basis Universal) image", 8},
                 {"DDS ", "a DDS image", 4},
                 {"GIF8", "a GIF image", 4},
                 {"8BPS", "a Photoshop image", 4},
                 {"BM", "a BMP image", 2},
                 {"#?", "a Radiance image", 2},
                 {"\x76\x2f\x31\x01", "an OpenEXR image", 4},
                 {"II*", "a TIFF image", 4},
                 {"MM\0*", "a TIFF image", 4}};
    if (bytes->size >= 12 && starts(bytes, "RIFF", 4) && memcmp(bytes->data + 8, "WEBP", 4) == 0)
        return "a WebP image";
    for (size_t i = 0; i < sizeof known / sizeof known[0]; i++)
        if (starts(bytes, known[i].magic, known[i].length))
            return known[i].kind;
    return bytes->any_format ? "neither PNG nor JPEG, BMP or TGA" : "neither PNG nor JPEG";
}

/* ---- limits ---- */

static uint64_t texels_of(const struct kiln_image_shape *shape) { return (uint64_t)shape->width * shape->height; }

uint64_t kiln_image_memory(void)
{
    struct rlimit most;
    return getrlimit(RLIMIT_AS, &most) != 0 || most.rlim_cur == RLIM_INFINITY ? KILN_IMAGE_MEMORY : most.rlim_cur;
}

static bool fits(uint64_t texels, uint64_t bytes_per_texel, uint64_t memory, uint64_t texels_per_byte, uint64_t earning)
{
    return texels <= memory / bytes_per_texel || texels / texels_per_byte <= earning;
}

bool kiln_images_have_room(struct kiln_images *images, uint64_t texels)
{
    const uint64_t all = images->texels + texels;
    if (!fits(all, 4, kiln_image_memory() / 2, KILN_TEXTURE_TEXELS_PER_BYTE, images->confine->total_bytes))
        return false;
    images->texels = all;
    return true;
}

/* Checks an image's size against the limits of one image and of all images of the scene. Adds its texels to the scene's
 * sum, unless `planned`: then kiln_image_plan has done so already. */
static int check_limits(struct kiln_images *images, const struct kiln_image_format *format,
                        const struct kiln_image_bytes *bytes, const struct kiln_image_shape *shape, bool planned,
                        struct kiln_error *error)
{
    const uint64_t texels = texels_of(shape), memory = kiln_image_memory();
    const unsigned w = shape->width, h = shape->height;
    if (w > KILN_IMAGE_SIDE_MAX || h > KILN_IMAGE_SIDE_MAX)
        return kiln_fail(error, KILN_BAD_INPUT, "%s is %u x %u pixels, more than %d a side; make it smaller",
                         bytes->where, w, h, KILN_IMAGE_SIDE_MAX);
    if (texels > shape->reach)
        return kiln_fail(error, KILN_BAD_INPUT,
                         "%s is a broken image (its header says %u x %u pixels, more than %zu bytes of %s can hold); "
                         "export it again",
                         bytes->where, w, h, bytes->size, format->name);
    if (!fits(texels, 4, memory / 8, KILN_TEXTURE_TEXELS_PER_BYTE, images->confine->total_bytes) ||
        (format->by_stb && !fits(texels, KILN_STB_BYTES_PER_TEXEL, memory / 3, KILN_STB_TEXELS_PER_BYTE, bytes->size)))
        return kiln_fail(error, KILN_BAD_INPUT,
                         "%s, %u x %u pixels in %zu bytes, takes more memory than kiln gives one image, with %llu MiB "
                         "for all it reads; make it smaller",
                         bytes->where, w, h, bytes->size, (unsigned long long)(memory >> 20));
    if (!planned && !kiln_images_have_room(images, texels))
        return kiln_fail(error, KILN_BAD_INPUT,
                         "%s, %u x %u pixels, brings the scene's images to %llu million pixels, more than half of the "
                         "%llu MiB of memory that kiln may use; make them smaller",
                         bytes->where, w, h, (unsigned long long)((images->texels + texels) / 1000000),
                         (unsigned long long)(memory >> 20));
    return KILN_OK;
}

static int measure(struct kiln_images *images, const struct kiln_image_bytes *bytes, bool planned,
                   const struct kiln_image_format **format, struct kiln_image_shape *shape, struct kiln_error *error)
{
    char reason[KILN_REASON_SIZE] = "";
    *format = format_of(bytes);
    if (*format == NULL)
        return kiln_fail(error, KILN_BAD_INPUT, "%s is %s; convert it to PNG or JPEG", bytes->where,
                         describe_format(bytes));
    if (!(*format)->measure(bytes->data, bytes->size, shape, reason))
        return kiln_fail(error, KILN_BAD_INPUT, "%s cannot be read (%s: %s); export the image again as PNG or JPEG",
                         bytes->where, (*format)->name, reason);
    return check_limits(images, *format, bytes, shape, planned, error);
}

static int decode(const struct kiln_image_format *format, const struct kiln_image_bytes *bytes,
                  const struct kiln_image_shape *shape, uint8_t *rgba, struct kiln_error *error)
{
    char reason[KILN_REASON_SIZE] = "";
    if (format->decode(bytes->data, bytes->size, shape, rgba, reason))
        return KILN_OK;
    return kiln_fail(error, KILN_BAD_INPUT, "%s is a broken image (%s: %s); export it again as PNG or JPEG",
                     bytes->where, format->name, reason);
}

/* ---- images decoded so far ---- */

/* The image's slot in the table, or the free slot for it. */
static struct kiln_image *slot_of(const struct kiln_images *images, const uint64_t hash[2], size_t size)
{
    size_t slot = (size_t)hash[0] & (images->slot_count - 1);
    while (images->slots[slot].size != 0 &&
           (images->slots[slot].size != size || memcmp(images->slots[slot].hash, hash, 2 * sizeof *hash) != 0))
        slot = (slot + 1) & (images->slot_count - 1);
    return &images->slots[slot];
}

static int make_room(struct kiln_images *images, struct kiln_error *error)
{
    if (2 * (images->used + 1) <= images->slot_count)
        return KILN_OK;
    struct kiln_images old = *images;
    images->slots = NULL;
    images->slot_count = old.slot_count == 0 ? 16 : 2 * old.slot_count;
    const int status = kiln_allocate(&images->slots, images->slot_count, sizeof *images->slots, "pictures", error);
    if (status != KILN_OK) {
        *images = old;
        return status;
    }
    for (size_t i = 0; i < old.slot_count; i++)
        if (old.slots[i].size != 0)
            *slot_of(images, old.slots[i].hash, old.slots[i].size) = old.slots[i];
    kiln_free(&old.slots);
    return KILN_OK;
}

static int find(struct kiln_images *images, const struct kiln_image_bytes *bytes, struct kiln_image **image,
                struct kiln_error *error)
{
    if (images->bytes / KILN_IMAGE_REPEATS > images->confine->total_bytes)
        return kiln_fail(error, KILN_BAD_INPUT,
                         "%s: with it the scene refers to %llu bytes of images, more than %llu times the bytes of "
                         "its files; refer to each image once",
                         bytes->where, (unsigned long long)images->bytes, (unsigned long long)KILN_IMAGE_REPEATS);
    const XXH128_hash_t hash = XXH3_128bits(bytes->data, bytes->size);
    const uint64_t words[2] = {hash.low64, hash.high64};
    const int status = bytes->size == 0 ? kiln_fail(error, KILN_BAD_INPUT,
                                                    "%s is empty; export the image again as PNG or JPEG", bytes->where)
                                        : make_room(images, error);
    if (status != KILN_OK)
        return status;
    *image = slot_of(images, words, bytes->size);
    images->used += (*image)->size == 0;
    (*image)->size = bytes->size;
    memcpy((*image)->hash, words, sizeof words);
    return KILN_OK;
}

int kiln_image_plan(struct kiln_images *images, const struct kiln_image_bytes *bytes, struct kiln_error *error)
{
    const struct kiln_image_format *format;
    struct kiln_image_shape shape = {0};
    struct kiln_image *image = NULL;
    struct kiln_error dropped;
    char reason[KILN_REASON_SIZE] = "";
    if (bytes->size == 0 || (format = format_of(bytes)) == NULL ||
        !format->measure(bytes->data, bytes->size, &shape, reason) ||
        find(images, bytes, &image, &dropped) != KILN_OK || image->planned)
        return KILN_OK; /* errors of the image are reported when it is decoded */
    const int status = check_limits(images, format, bytes, &shape, false, error);
    image->planned = status == KILN_OK;
    return status;
}

int kiln_images_reserve(struct kiln_images *images, struct kiln_error *error)
{
    return kiln_builder_reserve(images->builder, KILN_SECTION_TEXELS, 4 * (size_t)images->texels, error);
}

int kiln_image_append(struct kiln_images *images, const struct kiln_image_bytes *bytes, struct kiln_image *result,
                      struct kiln_error *error)
{
    const struct kiln_image_format *format;
    struct kiln_image_shape shape = {0};
    struct kiln_image *image = NULL;
    images->bytes += bytes->size;
    int status = find(images, bytes, &image, error);
    if (status == KILN_OK && !image->decoded) {
        size_t first = 0;
        status = measure(images, bytes, image->planned, &format, &shape, error);
        if (status == KILN_OK)
            status = kiln_builder_append(images->builder, KILN_SECTION_TEXELS, NULL, 4 * (size_t)texels_of(&shape),
                                         &first, error);
        if (status == KILN_OK)
            status = decode(format, bytes, &shape,
                            KILN_BUILDER_DATA(images->builder, uint8_t, KILN_SECTION_TEXELS) + first, error);
        image->first = first;
        image->width = shape.width;
        image->height = shape.height;
        image->decoded = status == KILN_OK;
    }
    if (status == KILN_OK)
        *result = *image;
    return status;
}

static void average(struct kiln_image *image, const uint8_t *rgba, uint64_t texels)
{
    uint64_t sum[4] = {0};
    for (uint64_t i = 0; i < texels; i++)
        for (int c = 0; c < 4; c++)
            sum[c] += rgba[4 * i + (uint64_t)c];
    for (int c = 0; c < 4; c++)
        image->mean[c] = (double)sum[c] / (255.0 * (double)texels);
    image->averaged = true;
}

/* Decodes an image for its mean only. */
static int decode_mean(struct kiln_images *images, const struct kiln_image_bytes *bytes, struct kiln_image *image,
                       struct kiln_error *error)
{
    const struct kiln_image_format *format;
    struct kiln_image_shape shape = {0};
    uint8_t *rgba = NULL;
    int status;
    KILN_TRY(measure(images, bytes, image->planned, &format, &shape, error));
    KILN_TRY(kiln_allocate(&rgba, (size_t)texels_of(&shape), 4, "a picture", error));
    KILN_TRY(decode(format, bytes, &shape, rgba, error));
    average(image, rgba, texels_of(&shape));
end:
    kiln_free(&rgba);
    return status;
}

int kiln_image_mean(struct kiln_images *images, const struct kiln_image_bytes *bytes, struct kiln_image *result,
                    struct kiln_error *error)
{
    struct kiln_image *image = NULL;
    images->bytes += bytes->size;
    int status;
    KILN_TRY(find(images, bytes, &image, error));
    if (!image->averaged) {
        if (image->decoded)
            average(image, KILN_BUILDER_DATA(images->builder, const uint8_t, KILN_SECTION_TEXELS) + image->first,
                    (uint64_t)image->width * image->height);
        else
            KILN_TRY(decode_mean(images, bytes, image, error));
    }
    *result = *image;
end:
    return status;
}

/* Tells why an image is not a normal map. A grey texel would be a normal that leans by 55 degrees, and normals of a map
 * never point into the surface. */
const char *kiln_image_no_normals(struct kiln_images *images, const struct kiln_image *image)
{
    struct kiln_image *known = slot_of(images, image->hash, image->size);
    if (known->judged)
        return known->no_normals;
    const uint8_t *rgba = KILN_BUILDER_DATA(images->builder, const uint8_t, KILN_SECTION_TEXELS) + image->first;
    const uint64_t texels = (uint64_t)image->width * image->height;
    uint64_t grey = 0, inward = 0;
    for (uint64_t i = 0; i < texels; i++) {
        const uint8_t *t = rgba + 4 * i;
        grey += t[0] == t[1] && t[1] == t[2];
        inward += t[2] < 128;
    }
    known->judged = true;
    known->no_normals = grey == texels        ? "all of it is grey, as in a map of heights"
                        : 2 * inward > texels ? "most of its normals point into the surface: their blue is below 128"
                                              : NULL;
    return known->no_normals;
}

void kiln_images_destroy(struct kiln_images *images)
{
    kiln_free(&images->slots);
    *images = (struct kiln_images){0};
}
