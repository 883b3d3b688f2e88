/* Bands of a lightmap's rows: whole strips, each row in one band, as equal as they can be. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "coordinator/output/exr_strips.h"
#include "coordinator/output/map/bands/assignment.h"
#include "coordinator/output/map/bands/bands.h"
#include "coordinator/output/map/write/texel_gather.h"

static void check_rows(uint32_t height, uint32_t ranks)
{
    uint32_t next = 0, most = 0;
    for (uint32_t r = 0; r < ranks; r++) {
        uint32_t first = 0, end = 0;
        kiln_bands_rows(height, r, ranks, &first, &end);
        assert_int_equal(first, next);
        assert_true(end == height || end % KILN_EXR_ROWS == 0);
        for (uint32_t y = first; y < end; y++)
            assert_int_equal(kiln_bands_rank(height, ranks, y), r);
        most = end - first > most ? end - first : most;
        next = end;
    }
    assert_int_equal(next, height);
    assert_true(most < height / ranks + 2 * KILN_EXR_ROWS);
}

static void rows_are_of_one_band(void **state)
{
    (void)state;
    const uint32_t heights[] = {1, 15, 16, 17, 100, 631, 16384}, ranks[] = {1, 2, 3, 7, 64, 1000, 1024};
    for (size_t i = 0; i < sizeof heights / sizeof *heights; i++)
        for (size_t k = 0; k < sizeof ranks / sizeof *ranks; k++)
            check_rows(heights[i], ranks[k]);
    for (uint32_t r = 0; r < 7; r++) { /* no rank has more than 1.2 times the mean of a large lightmap */
        uint32_t first = 0, end = 0;
        kiln_bands_rows(16384, r, 7, &first, &end);
        assert_true((double)(end - first) < 1.01 * 16384 / 7);
    }
}

/* One large lightmap among small ones is in bands, after the others; without others of its size none need be. */
static void large_ones_are_in_bands(void **state)
{
    (void)state;
    struct kiln_assignment *assignment = NULL;
    struct kiln_lightmap maps[40];
    for (size_t i = 0; i < 40; i++)
        maps[i] = (struct kiln_lightmap){.width = i == 17 ? 4096 : 1024, .height = 1024, .published = i != 3};
    assert_int_equal(kiln_assignment_create(&assignment, maps, 40, 4, 1ull << 40, 1, NULL), 0);
    for (size_t i = 0; i < 40; i++) {
        const uint32_t owner = assignment->owner[i];
        assert_true(i == 17 ? owner == KILN_IN_BANDS : i == 3 ? owner == KILN_NONE : owner < 4);
        assert_int_equal(assignment->round[i], i == 17 ? 1 : i == 3 ? KILN_NONE : 0);
    }
    assert_true(assignment->own_rounds == 1 && assignment->rounds == 2);
    kiln_assignment_destroy(&assignment);
    assert_int_equal(kiln_assignment_create(&assignment, maps, 40, 1, 1ull << 40, 1, NULL), 0);
    assert_int_equal(assignment->owner[17], 0); /* one rank has all of it anyway */
    kiln_assignment_destroy(&assignment);
    assert_int_equal(kiln_assignment_create(&assignment, maps, 40, 4, 1ull << 40, 1ull << 30, NULL), 0);
    assert_true(assignment->owner[17] < 4 && assignment->rounds == 1);
    kiln_assignment_destroy(&assignment);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(rows_are_of_one_band),
                                       cmocka_unit_test(large_ones_are_in_bands)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
