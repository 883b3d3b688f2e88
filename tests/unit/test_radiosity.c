/* Packed radiosity and order-free sums. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <float.h>
#include <math.h>

#include "coordinator/bake/energy.h"
#include "shaders/random.h"
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

static void exact_sums_do_not_depend_on_order(void **state)
{
    (void)state;
    const double unit = kiln_exact_unit(1000.0);
    struct kiln_exact_sum forward = {0}, backward = {0};
    double plain = 0.0;
    enum { COUNT = 20000 };
    for (int i = 0; i < COUNT; i++) {
        const double a = ldexp((double)kiln_hash1((uint32_t)i), -40 + i % 20), b = ldexp((double)kiln_hash1((uint32_t)(COUNT - 1 - i)), -40 + (COUNT - 1 - i) % 20);
        kiln_exact_add(&forward, a, unit);
        kiln_exact_add(&backward, b, unit);
        plain += a;
    }
    assert_true(forward.value == backward.value);
    assert_true(fabs(kiln_exact_value(&forward, unit) / plain - 1.0) < 1e-12);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(packing_keeps_values_near), cmocka_unit_test(rounding_has_no_bias),
                                       cmocka_unit_test(odd_values_are_tamed), cmocka_unit_test(exact_sums_do_not_depend_on_order)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
