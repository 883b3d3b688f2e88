/* Tests of how many light paths probes get. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "coordinator/bake/volume/probe_paths.h"

static void enough(void **state)
{
    (void)state;
    const uint64_t grid[3] = {4, 16, 8}; /* its largest face has 128 */
    struct kiln_integrate_settings settings = {.photons = 32768, .iterations = 16, .parts = 1};
    assert_int_equal(kiln_probe_paths_photons(&settings, 2, grid, 256), 256 * 128 / 16);
    settings.parts = 4;
    assert_int_equal(kiln_probe_paths_photons(&settings, 2, grid, 256), 256 * 128 / 64);
    assert_int_equal(kiln_probe_paths_photons(&settings, 1000, grid, 256), 4000);
    assert_int_equal(kiln_probe_paths_photons(&settings, 2, grid, 1 << 20), 32768);
}

static void given(void **state)
{
    (void)state;
    const uint64_t grid[3] = {2, 2, 2};
    struct kiln_integrate_settings settings = {.photons = 500, .iterations = 16, .parts = 1, .photons_given = true};
    assert_int_equal(kiln_probe_paths_photons(&settings, 2, grid, 16), 500);
    assert_int_equal(kiln_probe_paths_photons(&settings, 700, grid, 16), 700);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(enough), cmocka_unit_test(given)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
