/* Patches of the sky: they fill the hemisphere, each has its middle, and directions find theirs. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>

#include "shaders/shared/random.h"
#include "worker/light/sky_patches.h"

enum { KINDS = 4, DIRECTIONS = 200000 };

static void test_middles(void **state)
{
    (void)state;
    for (int k = 1; k < KINDS; k++) {
        double all = 0.0, steradians;
        for (uint32_t p = 0; p < kiln_sky_patches[k]; p++) {
            const struct kiln_dvec3 d = kiln_sky_patch_middle(p, kiln_sky_divisions[k], &steradians);
            assert_int_equal(kiln_sky_patch(d, kiln_sky_divisions[k]), p);
            assert_true(fabs(dvec3_length(d) - 1.0) < 1e-12 && steradians > 0.0);
            all += steradians;
        }
        assert_true(fabs(all - 2.0 * KILN_PI) < 1e-9);
    }
}

/* As many directions fall into a patch as its solid angle says, within 5 standard errors. */
static void test_shares(void **state)
{
    (void)state;
    uint32_t found[146] = {0};
    for (uint32_t i = 0; i < DIRECTIONS; i++) {
        const double y = 2.0 * (i + 0.5) / DIRECTIONS - 1.0, turn = 2.0 * KILN_PI * (kiln_hash2(i, 7) + 0.5) * 0x1p-32;
        const double r = sqrt(1.0 - y * y);
        found[kiln_sky_patch(dvec3(r * cos(turn), y, r * sin(turn)), 1)]++;
    }
    assert_true(found[145] == DIRECTIONS / 2);
    for (uint32_t p = 0; p < 145; p++) {
        double steradians;
        (void)kiln_sky_patch_middle(p, 1, &steradians);
        const double wanted = steradians / (4.0 * KILN_PI) * DIRECTIONS;
        assert_true(fabs(found[p] - wanted) < 5.0 * sqrt(wanted));
    }
}

/* The first patch of a band is about -z, and the next is towards +x. */
static void test_order(void **state)
{
    (void)state;
    assert_int_equal(kiln_sky_patch(dvec3(0.0, 0.0, -1.0), 1), 0);
    assert_int_equal(kiln_sky_patch(dvec3(sin(0.2), 0.0, -cos(0.2)), 1), 1);
    assert_int_equal(kiln_sky_patch(dvec3(-sin(0.2), 0.0, -cos(0.2)), 1), 29);
    assert_int_equal(kiln_sky_patch(dvec3(0.0, 1.0, 0.0), 1), 144);
    assert_int_equal(kiln_sky_patch(dvec3(0.0, 1.0, 0.0), 2), 576);
    assert_int_equal(kiln_sky_patch(dvec3(0.0, 1.0, 0.0), 4), 2304);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_middles), cmocka_unit_test(test_shares),
                                       cmocka_unit_test(test_order)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
