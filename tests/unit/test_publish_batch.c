/* Tests of files that are published together: none has its final name before all are synced, a batch that fails or is
 * given up leaves nothing, and an image in a batch has the bytes that it has alone. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "coordinator/files/publish.h"
#include "coordinator/output/exr.h"
#include "worker/base/memory.h"

enum { FILES = 40 };
static char folder[64];

static int make_folder(void **state)
{
    struct kiln_folder made;
    (void)state;
    (void)snprintf(folder, sizeof folder, "/tmp/kiln-batch-XXXXXX");
    if (mkdtemp(folder) == NULL)
        return -1;
    const int status = kiln_folder_open(&made, folder, "maps/back", true, NULL);
    kiln_folder_close(&made);
    return status;
}

static int remove_folder(void **state)
{
    char path[128];
    int status = 0;
    (void)state;
    for (int i = 0; i < 3; i++) { /* fails where a file was left */
        static const char *const below[] = {"/maps/back", "/maps", ""};
        (void)snprintf(path, sizeof path, "%s%s", folder, below[i]);
        status |= rmdir(path);
    }
    return status;
}

static void name_of(int i, char name[64]) { (void)snprintf(name, 64, "maps/%sfile%d", i % 2 == 0 ? "" : "back/", i); }

static bool is_there(const char *name)
{
    char path[192];
    (void)snprintf(path, sizeof path, "%s/%s", folder, name);
    return access(path, F_OK) == 0;
}

static void remove_file(const char *name)
{
    char path[192];
    (void)snprintf(path, sizeof path, "%s/%s", folder, name);
    assert_int_equal(unlink(path), 0);
}

static struct kiln_publish_batch *put_files(void)
{
    struct kiln_publish_batch *batch = NULL;
    assert_int_equal(kiln_publish_batch_create(&batch, NULL), 0);
    for (int i = 0; i < FILES; i++) {
        struct kiln_publish place;
        char name[64];
        int descriptor = -1;
        name_of(i, name);
        assert_int_equal(kiln_publish_begin(&place, folder, name, NULL), 0);
        assert_int_equal(kiln_publish_open(&place, &descriptor, NULL), 0);
        assert_int_equal(kiln_write_all(descriptor, name, strlen(name), 0, name, NULL), 0);
        (void)close(descriptor);
        assert_int_equal(kiln_publish_put(batch, &place, NULL), 0);
    }
    return batch;
}

static size_t count_files(void)
{
    size_t count = 0;
    for (int i = 0; i < FILES; i++) {
        char name[64];
        name_of(i, name);
        count += is_there(name);
    }
    return count;
}

static void test_all_are_published_at_the_end(void **state)
{
    struct kiln_publish_batch *batch = put_files();
    (void)state;
    assert_int_equal(count_files(), 0);
    assert_int_equal(kiln_publish_batch_finish(batch, NULL), 0);
    for (int i = 0; i < FILES; i++) {
        char name[64], *bytes = NULL;
        size_t size = 0;
        name_of(i, name);
        assert_int_equal(kiln_read_file_below(folder, name, 64, &bytes, &size, NULL), 0);
        assert_string_equal(bytes, name);
        kiln_free(&bytes);
        remove_file(name);
    }
    kiln_publish_batch_destroy(&batch);
}

/* A file that cannot be synced keeps all others from being renamed. */
static void test_no_file_is_renamed_before_all_are_synced(void **state)
{
    struct kiln_publish_batch *batch = put_files();
    struct kiln_error error = {{0}};
    (void)state;
    remove_file("maps/back/.file31.part");
    assert_int_equal(kiln_publish_batch_finish(batch, &error), KILN_IO);
    assert_non_null(strstr(error.message, "maps/back/.file31.part"));
    assert_int_equal(count_files(), 0);
    kiln_publish_batch_destroy(&batch);
}

static void test_a_batch_given_up_leaves_nothing(void **state)
{
    struct kiln_publish_batch *batch = put_files();
    (void)state;
    assert_true(is_there("maps/.file0.part"));
    kiln_publish_batch_destroy(&batch);
    assert_null(batch);
    assert_false(is_there("maps/.file0.part"));
    assert_int_equal(count_files(), 0);
}

static void test_an_image_has_the_same_bytes(void **state)
{
    const char *const names[] = {"R", "G", "B"};
    struct kiln_publish_batch *batch = NULL;
    struct kiln_image *image = NULL;
    char *bytes[2] = {NULL, NULL};
    size_t size[2] = {0, 0};
    (void)state;
    assert_int_equal(kiln_image_create(&image, 300, 200, names, 3, NULL), 0);
    for (size_t i = 0; i < 3 * 300 * 200; i++)
        image->channels[i % 3].values[i / 3] = (float)(i * 2654435761u % 1000003u);
    assert_int_equal(kiln_publish_batch_create(&batch, NULL), 0);
    assert_int_equal(kiln_exr_write_below(folder, "maps/alone", image, NULL, 0, NULL), 0);
    assert_int_equal(kiln_exr_put(batch, folder, "maps/batch", image, NULL, 0, NULL), 0);
    assert_false(is_there("maps/batch"));
    assert_int_equal(kiln_publish_batch_finish(batch, NULL), 0);
    assert_int_equal(kiln_read_file_below(folder, "maps/alone", 1 << 24, &bytes[0], &size[0], NULL), 0);
    assert_int_equal(kiln_read_file_below(folder, "maps/batch", 1 << 24, &bytes[1], &size[1], NULL), 0);
    assert_int_equal(size[0], size[1]);
    assert_memory_equal(bytes[0], bytes[1], size[0]);
    for (int i = 0; i < 2; i++)
        kiln_free(&bytes[i]);
    remove_file("maps/alone");
    remove_file("maps/batch");
    kiln_publish_batch_destroy(&batch);
    kiln_image_destroy(&image);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_all_are_published_at_the_end),
                                       cmocka_unit_test(test_no_file_is_renamed_before_all_are_synced),
                                       cmocka_unit_test(test_a_batch_given_up_leaves_nothing),
                                       cmocka_unit_test(test_an_image_has_the_same_bytes)};
    return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
