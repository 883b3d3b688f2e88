/* Tests of the range check of results. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <fcntl.h>
#include <hdf5.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "coordinator/output/read/ranges.h"

/* The verdict on a file with one dataset "/GROUP/NAME" of six values, all 0.5 but one. */
static int verdict_in(const char *folder, const char *name, double odd, char *message, size_t size)
{
    char path[] = "/tmp/kiln-ranges-XXXXXX.h5", full[64], in[32];
    const int descriptor = mkstemps(path, 3);
    assert_true(descriptor >= 0);
    (void)close(descriptor);
    const hsize_t extent[2] = {2, 3};
    double values[6] = {0.5, 0.5, 0.5, 0.5, odd, 0.5};
    (void)snprintf(in, sizeof in, "/%s", folder);
    (void)snprintf(full, sizeof full, "%s/%s", in, name);
    const hid_t file = H5Fcreate(path, H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT),
                space = H5Screate_simple(2, extent, NULL);
    const hid_t group = H5Gcreate2(file, in, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    const hid_t dataset = H5Dcreate2(file, full, H5T_NATIVE_FLOAT, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    assert_true(H5Dwrite(dataset, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values) >= 0);
    assert_true(H5Dclose(dataset) >= 0 && H5Gclose(group) >= 0 && H5Sclose(space) >= 0 && H5Fclose(file) >= 0);
    struct kiln_error error = {{0}};
    const int written = open(path, O_RDONLY);
    assert_true(written >= 0);
    const int status = kiln_ranges_check(written, path, &error);
    (void)close(written);
    (void)snprintf(message, size, "%s", error.message);
    (void)unlink(path);
    return status;
}

static int verdict(const char *name, double odd, char *message, size_t size)
{
    return verdict_in("irradiance", name, odd, message, size);
}

static void test_values(void **state)
{
    (void)state;
    char message[2048];
    assert_int_equal(verdict("total", 0.0, message, sizeof message), KILN_OK);
    assert_int_equal(verdict("total", -0.001, message, sizeof message), KILN_BAD_INPUT);
    assert_non_null(strstr(message, "/irradiance/total is -0.001 at value 4"));
    assert_int_equal(verdict("indirect", INFINITY, message, sizeof message), KILN_BAD_INPUT);
    assert_int_equal(verdict("harmonics", -3.0, message, sizeof message), KILN_OK); /* coefficients have a sign */
    assert_int_equal(verdict("harmonics", NAN, message, sizeof message), KILN_BAD_INPUT);
    assert_int_equal(verdict_in("points", "albedo", 1.5, message, sizeof message), KILN_BAD_INPUT);
}

/* Users name groups of lights: what a name ends with, or is in another folder, means nothing. */
static void test_groups(void **state)
{
    (void)state;
    char message[2048];
    static const char *const names[] = {"B", "albedo", "area", "total", "ambient_occlusion", "validity"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        assert_int_equal(verdict_in("groups", names[i], -0.25, message, sizeof message), KILN_OK);
        assert_int_equal(verdict_in("groups_direct", names[i], 1.5, message, sizeof message), KILN_OK);
        assert_int_equal(verdict_in("groups", names[i], NAN, message, sizeof message), KILN_BAD_INPUT);
    }
}

static void test_files_that_are_none(void **state)
{
    (void)state;
    struct kiln_error error = {{0}};
    static const char *const none[] = {"kiln.h5", "a.exr", "run.json", "scene.kscene"};
    const int empty = open("/dev/null", O_RDONLY);
    assert_true(empty >= 0);
    for (size_t i = 0; i < sizeof none / sizeof *none; i++)
        assert_true(kiln_ranges_has(none[i]) && kiln_ranges_check(empty, none[i], &error) != KILN_OK);
    assert_false(kiln_ranges_has("preview.png")); /* nothing in it to check */
    assert_int_equal(kiln_ranges_check(empty, "preview.png", &error), KILN_OK);
    (void)close(empty);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_values), cmocka_unit_test(test_groups),
                                       cmocka_unit_test(test_files_that_are_none)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
