/* Tests of the comparison metrics against values computed by hand; tests/output compares them with another program. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <string.h>

#include "coordinator/view/compare.h"
#include "worker/base/memory.h"

enum { WIDTH = 4, HEIGHT = 2, TEXELS = WIDTH * HEIGHT };

static struct kiln_image *constant(float value, bool masks)
{
    const char *const names[] = {"R", "G", "B", "validity.Y", "coverage.Y"};
    struct kiln_image *image = NULL;
    assert_int_equal(kiln_image_create(&image, WIDTH, HEIGHT, names, masks ? 5 : 3, NULL), 0);
    for (size_t c = 0; c < image->channel_count; c++)
        for (int i = 0; i < TEXELS; i++)
            image->channels[c].values[i] = strchr(image->channels[c].name, '.') != NULL ? 1.0f : value;
    return image;
}

static void assert_near(double found, double expected)
{
    if (!(fabs(found - expected) <= 1e-12 * fmax(1.0, fabs(expected))))
        fail_msg("%.17g is not %.17g", found, expected);
}

static void test_constant_offset(void **state)
{
    (void)state;
    struct kiln_image *a = constant(2.5f, false), *b = constant(2.0f, false);
    struct kiln_difference d;
    assert_int_equal(kiln_compare_images(a, b, &d, NULL), 0);
    assert_false(d.identical);
    assert_int_equal(d.texels, TEXELS);
    assert_int_equal(d.interior, TEXELS);
    assert_near(d.rmse, 0.5);
    assert_near(d.nrmse, 0.25);
    assert_near(d.rel_rmse, 0.5 / 2.02);
    assert_near(d.psnr, 20.0 * log10(4.0));
    assert_near(d.dfpr, 0.5 * sqrt(3.0));
    assert_near(d.dfpr_unit, 0.25 * sqrt(3.0));
    assert_near(d.dfpr_8bit, 0.0); /* more than the brightest value is as white */
    assert_int_equal(kiln_compare_images(b, a, &d, NULL), 0);
    assert_near(d.dfpr_8bit, 51.0 / 255.0 * sqrt(3.0));
    assert_int_equal(kiln_compare_images(a, b, &d, NULL), 0);
    assert_near(d.mean, 2.0);
    const double ta = 0.225 / 1.225, tb = 0.18 / 1.18; /* no variance: the similarity of the means alone */
    assert_true(fabs(d.dssim - 0.5 * (1.0 - (2 * ta * tb + 1e-4) / (ta * ta + tb * tb + 1e-4))) < 1e-6);
    assert_int_equal(d.channel_count, 3);
    assert_string_equal(d.channels[0].name, "R");
    assert_near(d.channels[2].mean_difference, 0.5);
    assert_int_equal(kiln_compare_images(a, a, &d, NULL), 0);
    assert_true(d.identical && d.rmse == 0.0 && isinf(d.psnr) && fabs(d.dssim) < 1e-7);
    kiln_image_destroy(&a);
    kiln_image_destroy(&b);
}

static void test_masks(void **state)
{
    (void)state;
    struct kiln_image *a = constant(1.0f, true), *b = constant(1.0f, true);
    struct kiln_difference d;
    kiln_image_find(a, "validity.Y")->values[0] = 0.5f; /* filled in a */
    kiln_image_find(a, "R")->values[0] = 100.0f;
    kiln_image_find(b, "validity.Y")->values[1] = 0.0f; /* margin in b */
    kiln_image_find(b, "G")->values[1] = -100.0f;
    kiln_image_find(b, "coverage.Y")->values[2] = 0.5f; /* valid, but not wholly inside a chart */
    kiln_image_find(a, "B")->values[2] = 3.0f;
    kiln_image_find(a, "B")->values[5] = NAN;
    assert_int_equal(kiln_compare_images(a, b, &d, NULL), 0);
    assert_int_equal(d.texels, TEXELS - 3);
    assert_int_equal(d.interior, TEXELS - 4);
    assert_int_equal(d.not_finite, 1);
    assert_near(d.rmse, sqrt(4.0 / (3.0 * (TEXELS - 3))));
    assert_near(d.nrmse, 0.0);
    assert_near(d.worst, 2.0);
    /* all pixels: one is as white, one is black in one channel of b, one as white; what is not finite is black */
    assert_near(d.dfpr_8bit, 2.0 / TEXELS);
    assert_int_equal(d.worst_x, 2);
    assert_int_equal(d.worst_y, 0);
    kiln_image_destroy(&a);
    kiln_image_destroy(&b);
}

static void test_identity_is_of_bits(void **state)
{
    (void)state;
    struct kiln_image *a = constant(0.0f, true), *b = constant(0.0f, true);
    struct kiln_difference d;
    kiln_image_find(a, "R")->values[3] = -0.0f;
    assert_int_equal(kiln_compare_images(a, b, &d, NULL), 0);
    assert_true(d.rmse == 0.0 && !d.identical);
    kiln_image_find(a, "R")->values[3] = 0.0f;
    kiln_image_find(a, "validity.Y")->values[7] = 0.0f; /* masks are part of the file */
    assert_int_equal(kiln_compare_images(a, b, &d, NULL), 0);
    assert_false(d.identical);
    kiln_image_destroy(&a);
    kiln_image_destroy(&b);
}

static void test_sets_add_up(void **state)
{
    (void)state;
    struct kiln_image *a = constant(2.0f, false), *b = constant(1.0f, false);
    struct kiln_difference same, other, set = {.identical = true};
    assert_int_equal(kiln_compare_images(b, b, &same, NULL), 0);
    assert_int_equal(kiln_compare_images(a, b, &other, NULL), 0);
    kiln_difference_add(&set, &same);
    assert_true(set.identical);
    kiln_difference_add(&set, &other);
    assert_false(set.identical);
    assert_int_equal(set.texels, 2 * TEXELS);
    assert_near(set.rmse, sqrt(0.5));
    assert_near(set.dfpr, 0.5 * sqrt(3.0));
    assert_near(set.mean, 1.0);
    kiln_image_destroy(&a);
    kiln_image_destroy(&b);
}

static void test_what_cannot_be_compared(void **state)
{
    (void)state;
    const char *const names[] = {"Z"};
    struct kiln_image *a = constant(1.0f, false), *b = NULL;
    struct kiln_difference d;
    struct kiln_error error = {{0}};
    assert_int_equal(kiln_image_create(&b, WIDTH, HEIGHT, names, 1, NULL), 0);
    assert_int_equal(kiln_compare_images(a, b, &d, &error), KILN_BAD_INPUT);
    kiln_image_destroy(&b);
    assert_int_equal(kiln_image_create(&b, WIDTH + 1, HEIGHT, names, 1, NULL), 0);
    assert_int_equal(kiln_compare_images(a, b, &d, &error), KILN_BAD_INPUT);
    assert_non_null(strstr(error.message, "4 x 2 and 5 x 2"));
    kiln_image_destroy(&a);
    kiln_image_destroy(&b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_constant_offset), cmocka_unit_test(test_masks),
                                       cmocka_unit_test(test_identity_is_of_bits), cmocka_unit_test(test_sets_add_up),
                                       cmocka_unit_test(test_what_cannot_be_compared)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
