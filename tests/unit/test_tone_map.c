/* Tests of tone curves against closed forms: greys, white, black, colours, what is not finite; and of automatic
 * exposure. */
#include <setjmp.h> // IWYU pragma: keep
#include <stdarg.h> // IWYU pragma: keep
#include <stddef.h> // IWYU pragma: keep
#include <stdint.h> // IWYU pragma: keep

#include <cmocka.h>

#include <float.h>
#include <math.h>

#include "coordinator/output/tone_map.h"

enum { CURVES = 4 };

static void near(double a, double b, double tolerance)
{
    if (!(fabs(a - b) <= tolerance))
        fail_msg("%.9g is not %.9g within %g", a, b, tolerance);
}

static double srgb(double linear)
{
    return linear <= 0.0031308 ? 12.92 * linear : 1.055 * pow(linear, 1.0 / 2.4) - 0.055;
}

static double grey(enum kiln_tone_curve curve, double white, double value)
{
    const struct kiln_tone tone = {curve, 1.0, white};
    const float rgb[3] = {(float)value, (float)value, (float)value};
    double code[3];
    kiln_tone_map_color(&tone, rgb, code);
    near(code[0], code[1], 1e-3); /* rows of the ACES matrices do not quite sum to 1 */
    near(code[0], code[2], 1e-3);
    return code[1];
}

/* Middle grey: as it is; Reinhard's equation 4; black and white. */
static void greys(void **state)
{
    (void)state;
    near(grey(KILN_TONE_NONE, 4.0, 0.18), srgb(0.18), 1e-7);
    near(grey(KILN_TONE_FILMIC, 4.0, 0.18), srgb(0.18), 1e-7);
    near(grey(KILN_TONE_ACES, 4.0, 0.18), srgb(0.18), 1e-4);
    near(grey(KILN_TONE_REINHARD, 4.0, 0.18), srgb(0.18 * (1.0 + 0.18 / 16.0) / 1.18), 1e-6);
    near(grey(KILN_TONE_REINHARD, INFINITY, 3.0), srgb(0.75), 1e-6);
    near(grey(KILN_TONE_REINHARD, 2.0, 2.0), 1.0, 1e-6);
    near(grey(KILN_TONE_NONE, 4.0, 0.5), srgb(0.5), 1e-7);
    near(grey(KILN_TONE_NONE, 4.0, 1.0), 1.0, 1e-12);
    for (int curve = 0; curve < CURVES; curve++) {
        assert_true(grey((enum kiln_tone_curve)curve, 4.0, 0.0) == 0.0);
        assert_true(grey((enum kiln_tone_curve)curve, 4.0, -1.0) == 0.0);
        near(grey((enum kiln_tone_curve)curve, 4.0, 1e30), 1.0, 1e-12);
    }
}

/* The filmic sigmoid by its own definition: ends, the slope of sRGB at middle grey, half a branch, range by white. */
static void filmic(void **state)
{
    (void)state;
    near(grey(KILN_TONE_FILMIC, 0.18 * exp2(5.0), 0.18 * exp2(5.0)), 1.0, 1e-6);
    assert_true(grey(KILN_TONE_FILMIC, 0.18 * exp2(5.0), 0.18 * exp2(4.9)) < 0.9995);
    near(grey(KILN_TONE_FILMIC, 1.0, 0.18 * exp2(4.0)), 1.0, 1e-6);
    assert_true(grey(KILN_TONE_FILMIC, 1.0, 0.18 * exp2(3.9)) < 0.9995);
    near(grey(KILN_TONE_FILMIC, INFINITY, 0.18 * exp2(6.5)), 1.0, 1e-6);
    assert_true(grey(KILN_TONE_FILMIC, INFINITY, 0.18 * exp2(6.4)) < 0.9995);
    near(grey(KILN_TONE_FILMIC, 4.0, 0.18 * exp2(-10.0)), 0.0, 1e-6);
    assert_true(grey(KILN_TONE_FILMIC, 4.0, 0.18 * exp2(-9.0)) > 1e-3);
    for (double step = -0.01; step < 0.02; step += 0.02)
        near((grey(KILN_TONE_FILMIC, INFINITY, 0.18 * exp2(step)) - srgb(0.18)) / step,
             (srgb(0.18 * exp2(step)) - srgb(0.18)) / step, 2e-3);
    /* t = 1 above: y0 + s / sqrt 2, at s / k stops */
    const double high = 1.0 - srgb(0.18), k = log(2.0) * 0.18 * 1.055 / 2.4 * pow(0.18, 1.0 / 2.4 - 1.0), run = 6.5 * k,
                 s = run / sqrt(run / high * run / high - 1.0);
    near(grey(KILN_TONE_FILMIC, INFINITY, 0.18 * exp2(s / k)), srgb(0.18) + s / sqrt(2.0), 1e-6);
}

/* Brighter is never darker, from 2^-20 to 2^20. */
static void monotonic(void **state)
{
    (void)state;
    for (int curve = 0; curve < CURVES; curve++) {
        double before = 0.0;
        for (double stops = -20.0; stops <= 20.0; stops += 0.05) {
            const double code = grey((enum kiln_tone_curve)curve, 4.0, exp2(stops));
            assert_true(code >= before && code <= 1.0);
            before = code;
        }
        near(before, 1.0, 1e-12);
    }
}

/* Colours: Reinhard keeps the hue; filmic and ACES turn bright saturated light to white; filmic leaves a colour of
 * middle lightness nearly what it is. */
static void colours(void **state)
{
    (void)state;
    struct kiln_tone tone = {KILN_TONE_REINHARD, 2.0, 4.0};
    const float red[3] = {0.2f, 0.1f, 0.05f}, lamp[3] = {60.0f, 20.0f, 6.0f}, laser[3] = {20.0f, 0.2f, 0.02f},
                soft[3] = {0.25f, 0.15f, 0.12f};
    double code[3];
    const double luminance = 2.0 * (0.2126 * 0.2 + 0.7152 * 0.1 + 0.0722 * 0.05),
                 scale = 2.0 * (1.0 + luminance / 16.0) / (1.0 + luminance);
    kiln_tone_map_color(&tone, red, code);
    for (int c = 0; c < 3; c++)
        near(code[c], srgb(scale * (double)red[c]), 1e-4);
    tone = (struct kiln_tone){KILN_TONE_FILMIC, 1.0, 4.0};
    kiln_tone_map_color(&tone, soft, code);
    for (int c = 0; c < 3; c++)
        near(code[c], srgb((double)soft[c]), 0.02);
    kiln_tone_map_color(&tone, lamp, code);
    assert_true(code[0] > 0.99 && code[1] > 0.9 && code[2] > 0.8);
    kiln_tone_map_color(&tone, laser, code);
    assert_true(code[0] > 0.99 && code[1] > 0.65 && code[2] > 0.6); /* 0.48 and 0.14 by themselves */
    tone.curve = KILN_TONE_ACES;
    kiln_tone_map_color(&tone, lamp, code);
    assert_true(code[0] > 0.95 && code[1] > 0.9 && code[2] > 0.8);
    tone.curve = KILN_TONE_NONE;
    tone.exposure = 2.0;
    kiln_tone_map_color(&tone, red, code);
    near(code[2], srgb(0.1), 1e-7);
}

/* Values that are not finite are magenta. The largest and smallest floats are shown under any exposure. */
static void not_finite(void **state)
{
    (void)state;
    const float bad[] = {NAN, INFINITY, -INFINITY};
    for (int curve = 0; curve < CURVES; curve++)
        for (int k = 0; k < 9; k++) {
            const struct kiln_tone tone = {(enum kiln_tone_curve)curve, 1.0, 4.0};
            float rgb[3] = {0.1f, 0.1f, 0.1f};
            rgb[k / 3] = bad[k % 3];
            double code[3];
            kiln_tone_map_color(&tone, rgb, code);
            assert_true(code[0] == 1.0 && code[1] == 0.0 && code[2] == 1.0);
        }
    for (int curve = 0; curve < CURVES; curve++)
        for (int k = 0; k < 4; k++) {
            const struct kiln_tone tone = {(enum kiln_tone_curve)curve, k % 2 == 0 ? 1e75 : 1e-75,
                                           k < 2 ? 4.0 : INFINITY};
            const float rgb[3] = {FLT_MAX, 1e-45f, 0.0f};
            double code[3];
            kiln_tone_map_color(&tone, rgb, code);
            for (int c = 0; c < 3; c++)
                assert_true(code[c] >= 0.0 && code[c] <= 1.0);
        }
}

static struct kiln_image *image_of(float value)
{
    static const char *const names[] = {"R", "G", "B"};
    struct kiln_image *image = NULL;
    float *planes[3];
    assert_int_equal(kiln_image_create(&image, 40, 50, names, 3, NULL), KILN_OK);
    assert_true(kiln_image_rgb(image, "", planes));
    for (int c = 0; c < 3; c++)
        for (int i = 0; i < 40 * 50; i++)
            planes[c][i] = value;
    return image;
}

/* A constant image is middle grey; lamps, black corners and what is not finite in 4 % of it do not matter. */
static void exposure(void **state)
{
    (void)state;
    for (int stops = -30; stops <= 30; stops += 15) {
        struct kiln_image *image = image_of((float)exp2(stops));
        float *planes[3];
        near(kiln_auto_exposure(image, 0.0).scale * exp2(stops), 0.18, 1e-9);
        near(kiln_auto_exposure(image, 0.0).white, 0.5, 1e-9);
        assert_true(kiln_image_rgb(image, "", planes));
        for (int i = 0; i < 80; i++)
            for (int c = 0; c < 3; c++) {
                planes[c][i] *= 1e4f;
                planes[c][100 + i] *= 1e-4f;
                planes[c][200 + i] = i % 2 == 0 ? NAN : INFINITY;
                planes[c][300 + i] = 0.0f;
            }
        near(kiln_auto_exposure(image, 0.0).scale * exp2(stops), 0.18, 1e-9);
        kiln_image_destroy(&image);
    }
    /* what is dark for the lights of the scene stays dark: 20 stops below what they could give are 10 below grey */
    struct kiln_image *leak = image_of(0.18f * 0x1p-20f);
    near(kiln_auto_exposure(leak, 0.18).scale, 0x1p10, 1e-3);
    near(kiln_auto_exposure(leak, 0.18 * 0x1p-8).scale, 0x1p18, 1.0);
    near(kiln_auto_exposure(leak, 0.18 * 0x1p-12).scale, 0x1p20, 1.0);
    kiln_image_destroy(&leak);
    struct kiln_image *black = image_of(0.0f);
    assert_true(kiln_auto_exposure(black, 0.0).scale == 1.0);
    kiln_image_destroy(&black);
}

/* The bytes of an image are the rounded codes. */
static void bytes(void **state)
{
    (void)state;
    struct kiln_image *image = image_of(0.18f);
    const struct kiln_tone tone = {KILN_TONE_NONE, 1.0, 4.0};
    uint8_t out[3 * 40 * 50];
    assert_int_equal(kiln_tone_map(image, &tone, out, NULL), KILN_OK);
    for (size_t i = 0; i < sizeof out; i++)
        assert_int_equal(out[i], 118); /* 255 x 0.4614 = 117.6 */
    kiln_image_destroy(&image);
}

/* Tables of images agree with the curves, for any colours, exposures and ranges. */
static void bytes_of_many_colours(void **state)
{
    (void)state;
    enum { WIDTH = 512, HEIGHT = 512 };
    static const char *const names[] = {"R", "G", "B"};
    static uint8_t out[3 * WIDTH * HEIGHT];
    struct kiln_image *image = NULL;
    float *planes[3];
    uint32_t random = 1;
    assert_int_equal(kiln_image_create(&image, WIDTH, HEIGHT, names, 3, NULL), KILN_OK);
    assert_true(kiln_image_rgb(image, "", planes));
    for (size_t i = 0; i < (size_t)WIDTH * HEIGHT; i++) { /* 24 stops of light, 6 of colour, some of it negative */
        random = random * 1664525u + 1013904223u;
        const double level = exp2((double)(random >> 8) / 0x1p24 * 24.0 - 16.0);
        for (int c = 0; c < 3; c++) {
            random = random * 1664525u + 1013904223u;
            const double part = exp2((double)(random >> 8) / 0x1p24 * 6.0 - 5.0);
            planes[c][i] = (float)(random >> 8 < 1u << 17 ? -part * level : part * level);
        }
    }
    for (double white = 0.5; white < 1e6; white *= 7.3) {
        const struct kiln_tone tone = {KILN_TONE_FILMIC, 0.3 + 1.0 / white, white};
        assert_int_equal(kiln_tone_map(image, &tone, out, NULL), KILN_OK);
        for (size_t i = 0; i < (size_t)WIDTH * HEIGHT; i++) {
            double code[3];
            kiln_tone_map_color(&tone, (float[3]){planes[0][i], planes[1][i], planes[2][i]}, code);
            for (size_t c = 0; c < 3; c++)
                if (out[3 * i + c] != (uint8_t)(255.0 * code[c] + 0.5))
                    fail_msg("white %g, %g %g %g: %u, not %.9g", white, (double)planes[0][i], (double)planes[1][i],
                             (double)planes[2][i], out[3 * i + c], 255.0 * code[c]);
        }
    }
    kiln_image_destroy(&image);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(greys),      cmocka_unit_test(filmic),
                                       cmocka_unit_test(monotonic),  cmocka_unit_test(colours),
                                       cmocka_unit_test(not_finite), cmocka_unit_test(exposure),
                                       cmocka_unit_test(bytes),      cmocka_unit_test(bytes_of_many_colours)};
    return cmocka_run_group_tests_name("tone_map", tests, NULL, NULL);
}
