/* Tests of OpenEXR files: values are read as they were written, also at half precision and odd sizes; damaged files are
 * refused. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "coordinator/output/exr.h"
#include "coordinator/output/exr_strips.h"
#include "coordinator/files/publish.h"
#include "worker/base/memory.h"

static char folder[64];

static int make_folder(void **state)
{
    (void)state;
    (void)snprintf(folder, sizeof folder, "/tmp/kiln-exr-XXXXXX");
    return mkdtemp(folder) == NULL;
}

static int remove_folder(void **state)
{
    (void)state;
    return rmdir(folder); /* fails where a temporary file was left */
}

static struct kiln_image *gradient(uint32_t width, uint32_t height)
{
    const char *const names[] = {"R", "G", "B", "direct.R", "error.Y"};
    struct kiln_image *image = NULL;
    assert_int_equal(kiln_image_create(&image, width, height, names, 5, NULL), 0);
    for (size_t c = 0; c < 5; c++)
        for (size_t i = 0; i < (size_t)width * height; i++)
            image->channels[c].values[i] = (float)(c + 1) * ldexpf(1.0f + (float)(i % 97) / 97.0f, (int)(i % 21) - 10);
    return image;
}

static void same_bytes(const char *a, const char *b)
{
    char *bytes[2] = {NULL, NULL};
    size_t size[2] = {0, 0};
    assert_int_equal(kiln_read_file(a, 1 << 24, &bytes[0], &size[0], NULL), 0);
    assert_int_equal(kiln_read_file(b, 1 << 24, &bytes[1], &size[1], NULL), 0);
    assert_int_equal(size[0], size[1]);
    assert_memory_equal(bytes[0], bytes[1], size[0]);
    kiln_free(&bytes[0]);
    kiln_free(&bytes[1]);
}

/* Begins `path` and appends strips until `end`, each packed from an image that has no other rows. */
static struct kiln_exr_file *append_strips(const char *path, const struct kiln_image *image,
                                           const struct kiln_exr_attribute *attributes, size_t attribute_count,
                                           uint32_t end)
{
    struct kiln_exr_file *file = NULL;
    struct kiln_error error = {{0}};
    assert_int_equal(kiln_exr_file_create(&file, NULL, path, image, attributes, attribute_count, &error), 0);
    for (uint32_t y = 0; y < end; y += KILN_EXR_ROWS) {
        struct kiln_image_channel channels[KILN_EXR_CHANNELS];
        struct kiln_image alone = *image;
        struct kiln_exr_strip strip;
        alone.channels = channels;
        alone.height = image->height - y < KILN_EXR_ROWS ? image->height - y : KILN_EXR_ROWS;
        memcpy(channels, image->channels, image->channel_count * sizeof *channels);
        for (size_t c = 0; c < image->channel_count; c++)
            channels[c].values += (size_t)y * image->width;
        if (kiln_exr_strip_pack(&alone, 0, &strip, &error) != KILN_OK)
            fail_msg("%s", error.message);
        assert_true(strip.values == kiln_exr_strip_values(image, y));
        assert_int_equal(kiln_exr_file_append(file, strip.bytes, strip.size, strip.hash, &error), 0);
        kiln_free(&strip.bytes);
    }
    return file;
}

/* A file packed strip by strip has the same bytes as one that is written at once. */
static void check_strips(const char *whole, const struct kiln_image *image, const struct kiln_exr_attribute *attributes,
                         size_t attribute_count)
{
    char path[128];
    (void)snprintf(path, sizeof path, "%s/strips.exr", folder);
    struct kiln_exr_file *file = append_strips(path, image, attributes, attribute_count, image->height);
    struct kiln_error error = {{0}};
    if (kiln_exr_file_publish(file, &error) != KILN_OK)
        fail_msg("%s", error.message);
    kiln_exr_file_destroy(&file);
    same_bytes(whole, path);
    assert_int_equal(unlink(path), 0);
}

static void check_round_trip(uint32_t width, uint32_t height)
{
    char path[128];
    (void)snprintf(path, sizeof path, "%s/a.exr", folder);
    struct kiln_image *image = gradient(width, height), *found = NULL;
    kiln_image_find(image, "error.Y")->half = true;
    const struct kiln_exr_attribute attributes[] = {{.name = "kiln:units", .kind = KILN_EXR_STRING, .text = "W m-2"},
                                                    {.name = "kiln:seed", .kind = KILN_EXR_INTEGER, .integer = 7}};
    struct kiln_error error = {{0}};
    assert_int_equal(kiln_exr_write(path, image, attributes, 2, &error), 0);
    assert_int_equal(kiln_exr_read(path, NULL, 0, &found, &error), 0);
    assert_int_equal(found->width, width);
    assert_int_equal(found->height, height);
    assert_int_equal(found->channel_count, 5);
    for (size_t c = 0; c < 5; c++) {
        const struct kiln_image_channel *channel = kiln_image_find(found, image->channels[c].name);
        assert_non_null(channel);
        assert_int_equal(channel->half, image->channels[c].half);
        for (size_t i = 0; i < (size_t)width * height; i++) {
            const float expected = image->channels[c].values[i], tolerance = channel->half ? expected * 0x1p-11f : 0.0f;
            assert_true(fabsf(channel->values[i] - expected) <= tolerance);
        }
    }
    kiln_image_destroy(&found);
    const char *const wanted[] = {"G", "nothing"};
    assert_int_equal(kiln_exr_read(path, wanted, 2, &found, &error), 0);
    assert_int_equal(found->channel_count, 1);
    assert_memory_equal(found->channels[0].values, kiln_image_find(image, "G")->values, sizeof(float) * width * height);
    kiln_image_destroy(&found);
    check_strips(path, image, attributes, 2);
    kiln_image_destroy(&image);
    assert_int_equal(unlink(path), 0);
}

static void test_round_trip(void **state)
{
    (void)state;
    check_round_trip(1, 1);
    check_round_trip(3, 16);
    check_round_trip(64, 17);
    check_round_trip(129, 65);
}

/* Among these some pack to exactly the size that they have unpacked, which a file cannot tell from a chunk left
 * unpacked: noise after 10 to 14 equal values. Writing reads each back. */
static void test_packed_size_equal_to_unpacked(void **state)
{
    (void)state;
    const char *const names[] = {"B", "G", "R"}; /* as a row of the file has them */
    char path[128];
    (void)snprintf(path, sizeof path, "%s/b.exr", folder);
    struct kiln_image *image = NULL;
    assert_int_equal(kiln_image_create(&image, 7, 7, names, 3, NULL), 0);
    uint32_t random = 1;
    for (uint32_t round = 0; round < 200; round++) {
        for (uint32_t c = 0; c < 3; c++)
            for (uint32_t i = 0; i < 49; i++) {
                random = random * 747796405u + 2891336453u;
                const uint32_t place = i / 7 * 21 + c * 7 + i % 7;
                image->channels[c].values[i] = place < 10 + round % 5 ? 1.0f : 0.5f + ldexpf((float)(random >> 9), -24);
            }
        struct kiln_error error = {{0}};
        if (kiln_exr_write(path, image, NULL, 0, &error) != KILN_OK)
            fail_msg("round %u: %s", round, error.message);
        check_strips(path, image, NULL, 0);
    }
    kiln_image_destroy(&image);
    assert_int_equal(unlink(path), 0);
}

/* A strip that is not what its hash says, one too few, one too many: refused, and no file is left. */
static void test_wrong_strips(void **state)
{
    (void)state;
    char path[128];
    (void)snprintf(path, sizeof path, "%s/wrong.exr", folder);
    struct kiln_image *image = gradient(20, 40);
    struct kiln_exr_strip strip;
    struct kiln_error error = {{0}};
    struct kiln_exr_file *file = append_strips(path, image, NULL, 0, 32);
    assert_int_equal(kiln_exr_file_publish(file, &error), KILN_BUG);
    kiln_exr_file_destroy(&file);
    file = append_strips(path, image, NULL, 0, 32);
    assert_int_equal(kiln_exr_strip_pack(image, 32, &strip, NULL), 0);
    assert_int_equal(kiln_exr_file_append(file, strip.bytes, strip.size, strip.hash + 1, NULL), 0);
    assert_int_equal(kiln_exr_file_append(file, strip.bytes, strip.size, strip.hash, NULL), KILN_BUG);
    assert_int_equal(kiln_exr_file_publish(file, &error), KILN_IO);
    assert_non_null(strstr(error.message, "row 32"));
    kiln_exr_file_destroy(&file);
    kiln_free(&strip.bytes);
    kiln_image_destroy(&image);
    assert_int_equal(access(path, F_OK), -1);
}

static void test_half_overflow_is_refused(void **state)
{
    (void)state;
    char path[128];
    (void)snprintf(path, sizeof path, "%s/half.exr", folder);
    struct kiln_image *image = gradient(4, 4);
    struct kiln_image_channel *red = kiln_image_find(image, "R");
    red->half = true;
    struct kiln_error error = {{0}};
    red->values[5] = 65520.0f;
    assert_int_equal(kiln_exr_write(path, image, NULL, 0, &error), KILN_BUG);
    assert_non_null(strstr(error.message, "half"));
    assert_int_equal(access(path, F_OK), -1);
    red->values[5] = 65519.0f;
    assert_int_equal(kiln_exr_write(path, image, NULL, 0, &error), 0);
    kiln_image_destroy(&image);
    assert_int_equal(unlink(path), 0);
}

/* Every cut and a sample of flipped bytes: an error or an image, never a crash; a cut is always noticed. */
static void test_damaged_files(void **state)
{
    (void)state;
    char path[128], broken[128];
    (void)snprintf(path, sizeof path, "%s/a.exr", folder);
    (void)snprintf(broken, sizeof broken, "%s/b.exr", folder);
    struct kiln_image *image = gradient(31, 33), *found = NULL;
    assert_int_equal(kiln_exr_write(path, image, NULL, 0, NULL), 0);
    char *bytes = NULL;
    size_t size = 0;
    assert_int_equal(kiln_read_file(path, 1 << 20, &bytes, &size, NULL), 0);
    for (size_t cut = 0; cut < size; cut += 1 + size / 40) {
        struct kiln_error error = {{0}};
        assert_int_equal(kiln_publish_bytes(broken, bytes, cut, NULL), 0);
        assert_int_equal(kiln_exr_read(broken, NULL, 0, &found, &error), KILN_BAD_INPUT);
        assert_non_null(strstr(error.message, "b.exr"));
        assert_null(found);
    }
    for (size_t at = 0; at < size; at += 1 + size / 200) {
        bytes[at] = (char)(bytes[at] ^ 0x41);
        assert_int_equal(kiln_publish_bytes(broken, bytes, size, NULL), 0);
        if (kiln_exr_read(broken, NULL, 0, &found, NULL) == 0)
            kiln_image_destroy(&found);
        bytes[at] = (char)(bytes[at] ^ 0x41);
    }
    kiln_free(&bytes);
    kiln_image_destroy(&image);
    assert_int_equal(unlink(path), 0);
    assert_int_equal(unlink(broken), 0);
    assert_int_equal(kiln_exr_read(path, NULL, 0, &found, NULL), KILN_NO_INPUT);
}

static void test_publish_does_not_follow_links(void **state)
{
    (void)state;
    char target[128], planted[128], temporary[KILN_PATH_SIZE];
    (void)snprintf(target, sizeof target, "%s/victim", folder);
    (void)snprintf(planted, sizeof planted, "%s/out", folder);
    assert_int_equal(kiln_publish_bytes(target, "precious", 8, NULL), 0);
    assert_int_equal(symlink(target, planted), 0);
    assert_int_equal(kiln_publish_bytes(planted, "new", 3, NULL), 0);
    char *bytes = NULL;
    size_t size = 0;
    assert_int_equal(kiln_read_file(target, 100, &bytes, &size, NULL), 0);
    assert_string_equal(bytes, "precious");
    kiln_free(&bytes);
    /* at the temporary name: a link planted there is replaced, not written through */
    (void)snprintf(temporary, sizeof temporary, "%s/.out.part", folder);
    assert_int_equal(symlink(target, temporary), 0);
    assert_int_equal(kiln_publish_bytes(planted, "newer", 5, NULL), 0);
    assert_int_equal(kiln_read_file(target, 100, &bytes, &size, NULL), 0);
    assert_string_equal(bytes, "precious");
    kiln_free(&bytes);
    assert_int_equal(kiln_read_file(planted, 100, &bytes, &size, NULL), 0);
    assert_string_equal(bytes, "newer");
    kiln_free(&bytes);
    assert_int_equal(unlink(target), 0);
    assert_int_equal(unlink(planted), 0);
}

static void test_missing_folder_is_told(void **state)
{
    (void)state;
    struct kiln_error error = {{0}};
    assert_int_equal(kiln_publish_bytes("/nonexistent-folder/x", "a", 1, &error), KILN_CANNOT_CREATE);
    assert_non_null(strstr(error.message, "/nonexistent-folder/"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_round_trip),
                                       cmocka_unit_test(test_packed_size_equal_to_unpacked),
                                       cmocka_unit_test(test_wrong_strips),
                                       cmocka_unit_test(test_half_overflow_is_refused),
                                       cmocka_unit_test(test_damaged_files),
                                       cmocka_unit_test(test_publish_does_not_follow_links),
                                       cmocka_unit_test(test_missing_folder_is_told)};
    return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
