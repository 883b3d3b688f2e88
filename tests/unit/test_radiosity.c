/* Tests of packed radiosity and of sums that do not depend on their order. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <float.h>
#include <math.h>

#include "coordinator/integrate/energy.h"
#include "shaders/shared/random.h"
#include "worker/scene/radiosity.h"

static void packing_keeps_values_near(void **state)
{
    (void)state;
    for (uint32_t i = 0; i < 100000; i++) {
        const float scale = ldexpf(1.0f, (int)(kiln_hash1(i) % 200) - 100);
        const float in[3] = {scale * 1.37f, scale * (1.0f + (float)(i % 997)), scale / 3.0f};
        float out[3];
        kiln_radiosity_unpack(kiln_radiosity_pack(in, kiln_hash1(i + 7)), out);
        for (int c = 0; c < 3; c++)
            assert_true(fabsf(out[c] / in[c] - 1.0f) <= 0x1p-13f);
    }
}

/* The mean over many hashes is the value: a furnace does not drift. */
static void rounding_has_no_bias(void **state)
{
    (void)state;
    const float in[3] = {0.99f, 1234.567f, 3.1e-7f};
    double sum[3] = {0};
    const uint32_t n = 1 << 20;
    for (uint32_t i = 0; i < n; i++) {
        float out[3];
        kiln_radiosity_unpack(kiln_radiosity_pack(in, kiln_hash1(i)), out);
        for (int c = 0; c < 3; c++)
            sum[c] += (double)out[c] / n;
    }
    for (int c = 0; c < 3; c++)
        assert_true(fabs(sum[c] / (double)in[c] - 1.0) < 5e-7);
}

static void odd_values_are_tamed(void **state)
{
    (void)state;
    const float in[3] = {-1.0f, NAN, INFINITY};
    float out[3];
    kiln_radiosity_unpack(kiln_radiosity_pack(in, 0xffffffffu), out);
    assert_true(out[0] == 0.0f && out[1] == 0.0f && isfinite(out[2]) && out[2] > 3e38f);
    const float largest[3] = {FLT_MAX, FLT_MAX, FLT_MAX};
    kiln_radiosity_unpack(kiln_radiosity_pack(largest, 0xffffffffu), out);
    assert_true(isfinite(out[0]) && isfinite(out[1]) && isfinite(out[2]));
}

static void expand(const float in[3], double scale, uint32_t hash, float out[3])
{
    kiln_radiosity_expand(kiln_radiosity_compact(in, scale, hash), scale, out);
}

/* A step of the largest channel is at most a part in 255 of it, and every channel is off by less than that (blue: than
 * two). */
static void compact_form_keeps_values_near(void **state)
{
    (void)state;
    for (uint32_t i = 0; i < 200000; i++) {
        const double scale = ldexp(1.0, (int)(kiln_hash1(i) % 60) - 30);
        const float size = ldexpf(kiln_hash1(i + 1) % 1000 == 0 ? 1.0f : (float)kiln_hash1(i + 2) * 0x1p-32f + 0.5f,
                                  (int)(kiln_hash1(i + 3) % 40) - 20);
        const float in[3] = {size * (float)scale, size * (float)scale * (float)(i % 97) / 96.0f,
                             size * (float)scale * (float)(i % 7) / 6.0f};
        float out[3];
        expand(in, scale, kiln_hash1(i + 7), out);
        for (int c = 0; c < 3; c++)
            assert_true(fabs((double)out[c] - (double)in[c]) < (c == 2 ? 2.0 : 1.0) * (double)size * scale / 255.0);
    }
}

/* Packing a value again does not change it, in this form or in the 8-byte form, whatever the random bits. */
static void compact_values_stay_what_they_are(void **state)
{
    (void)state;
    for (uint32_t i = 0; i < 300000; i++) {
        const double scale = ldexp(1.0, (int)(i % 31) - 15);
        const uint32_t bits =
            i < 100000 ? kiln_hash1(i)
                       : kiln_radiosity_compact((const float[3]){(float)(i % 512), (float)(i % 511), (float)(i % 509)},
                                                scale, kiln_hash1(i));
        float first[3], second[3], third[3];
        kiln_radiosity_expand(bits, scale, first);
        kiln_radiosity_unpack(kiln_radiosity_pack(first, kiln_hash1(i + 1)), second);
        expand(second, scale, kiln_hash1(i + 2), third);
        for (int c = 0; c < 3; c++)
            assert_true(!(first[c] < second[c]) && !(first[c] > second[c]) && !(first[c] < third[c]) &&
                        !(first[c] > third[c]));
    }
}

/* The mean over many hashes is the value, channel by channel, far above and far below the scale too. */
static void compact_rounding_has_no_bias(void **state)
{
    (void)state;
    const float values[4][3] = {
        {0.99f, 0.123f, 0.0077f}, {1234.567f, 3.1e6f, 7e5f}, {3.1e-7f, 3e-8f, 1e-7f}, {0.01f, 0.01f, 1.0f}};
    const uint32_t n = 1 << 20;
    for (int v = 0; v < 4; v++) {
        double sum[3] = {0};
        for (uint32_t i = 0; i < n; i++) {
            float out[3];
            expand(values[v], 1.0, kiln_hash1(i), out);
            for (int c = 0; c < 3; c++)
                sum[c] += (double)out[c] / n;
        }
        const double step = fmax((double)fmaxf(values[v][0], values[v][1]) / 255.0, (double)values[v][2] / 255.0);
        /* ten random bits: a 1024th of a step, and the noise of 2^20 draws of half a step (blue: of one) */
        for (int c = 0; c < 3; c++)
            assert_true(fabs(sum[c] - (double)values[v][c]) < step * (2.0 / 1024.0 + 4.0 / 1024.0));
    }
}

static void compact_form_tames_odd_values(void **state)
{
    (void)state;
    float out[3];
    expand((const float[3]){-1.0f, NAN, INFINITY}, 1.0, 0xffffffffu, out);
    assert_true(out[0] == 0.0f && out[1] == 0.0f && isfinite(out[2]) && out[2] > 1e9f);
    expand((const float[3]){1e30f, 1.0f, 0.0f}, 1.0, 0xffffffffu, out);
    assert_true(isfinite(out[0]) && out[0] > 1e9f && out[2] == 0.0f);
    expand((const float[3]){0.0f, 0.0f, 0.0f}, 1.0, 0xffffffffu, out);
    assert_true(out[0] == 0.0f && out[1] == 0.0f && out[2] == 0.0f);
    expand((const float[3]){1e-30f, 0.0f, 0.0f}, 1.0, 0x3ffu, out);
    assert_true(out[0] < 1e-11f);
}

static void exact_sums_do_not_depend_on_order(void **state)
{
    (void)state;
    const double unit = kiln_exact_unit(1000.0);
    struct kiln_exact_sum forward = {0}, backward = {0};
    double plain = 0.0;
    enum { COUNT = 20000 };
    for (int i = 0; i < COUNT; i++) {
        const double a = ldexp((double)kiln_hash1((uint32_t)i), -40 + i % 20),
                     b = ldexp((double)kiln_hash1((uint32_t)(COUNT - 1 - i)), -40 + (COUNT - 1 - i) % 20);
        kiln_exact_add(&forward, a, 1.0 / unit);
        kiln_exact_add(&backward, b, 1.0 / unit);
        plain += a;
    }
    assert_true(forward.value == backward.value);
    assert_true(fabs(kiln_exact_value(&forward, unit) / plain - 1.0) < 1e-12);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(packing_keeps_values_near),
                                       cmocka_unit_test(rounding_has_no_bias),
                                       cmocka_unit_test(odd_values_are_tamed),
                                       cmocka_unit_test(compact_form_keeps_values_near),
                                       cmocka_unit_test(compact_values_stay_what_they_are),
                                       cmocka_unit_test(compact_rounding_has_no_bias),
                                       cmocka_unit_test(compact_form_tames_odd_values),
                                       cmocka_unit_test(exact_sums_do_not_depend_on_order)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
