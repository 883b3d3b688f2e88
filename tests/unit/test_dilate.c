/* Tests of filling invalid points and of dilating margins. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdlib.h>
#include <string.h>

#include "coordinator/output/map/charts/dilate.h"
#include "coordinator/output/map/charts/fill.h"
#include "coordinator/output/map/charts/nearest.h"
#include "worker/base/memory.h"
#include "worker/scene/scene.h"

static uint64_t random_state = 12345;

static uint32_t random_bits(void)
{
    random_state = random_state * 6364136223846793005ull + 1442695040888963407ull;
    return (uint32_t)(random_state >> 33);
}

/* Compares with trying every pair of texels. */
static void check_nearest(uint32_t width, uint32_t height, uint32_t one_in)
{
    uint8_t state[40 * 40] = {0};
    uint32_t nearest[40 * 40];
    for (uint32_t i = 0; i < width * height; i++)
        state[i] = random_bits() % one_in == 0 ? (uint8_t)(1 + random_bits() % 2) : 0;
    for (uint8_t least = 1; least <= 2; least++) {
        assert_int_equal(kiln_nearest_texels(state, least, width, height, nearest, NULL), 0);
        for (int64_t i = 0; i < width * height; i++) {
            int64_t best = INT64_MAX;
            for (int64_t j = 0; j < width * height; j++) {
                const int64_t dx = i % width - j % width, dy = i / width - j / width;
                if (state[j] >= least && dx * dx + dy * dy < best)
                    best = dx * dx + dy * dy;
            }
            if (best == INT64_MAX) {
                assert_int_equal(nearest[i], KILN_NONE);
                continue;
            }
            assert_true(nearest[i] < width * height && state[nearest[i]] >= least);
            const int64_t dx = i % width - nearest[i] % width, dy = i / width - nearest[i] / width;
            assert_int_equal(dx * dx + dy * dy, best);
        }
    }
}

static void test_nearest_is_exact(void **state)
{
    (void)state;
    for (uint32_t trial = 0; trial < 30; trial++)
        check_nearest(1 + random_bits() % 40, 1 + random_bits() % 40, 1u << random_bits() % 10);
    check_nearest(40, 40, 1);
    check_nearest(1, 1, 1);
}

static struct kiln_map *striped_map(void)
{
    struct kiln_map *map = NULL;
    assert_int_equal(kiln_map_create(&map, 12, 6, &kiln_map_light, NULL), 0);
    for (uint32_t i = 0; i < 72; i++) {
        const uint32_t x = i % 12;
        if (x == 5 || x == 6 || i / 12 == 5) /* a margin two texels wide between two charts, and the last row */
            continue;
        map->state[i] = KILN_TEXEL_VALID;
        map->chart[i] = x < 5 ? 0 : 1;
        for (int p = 0; p < KILN_MAP_PLANES; p++)
            map->planes[p][i] = (x < 5 ? 1.0f : 9.0f) * (float)(p + 1);
    }
    return map;
}

static void test_fill_stays_in_the_chart(void **state)
{
    (void)state;
    struct kiln_map *map = striped_map();
    for (uint32_t y = 0; y < 5; y++)
        for (uint32_t x = 1; x < 5; x++) { /* only column 0 of chart 0 stays valid; column 4 is nearer to chart 1 */
            map->state[12 * y + x] = KILN_TEXEL_FILLED;
            map->planes[0][12 * y + x] = 1e30f; /* not light */
        }
    assert_int_equal(kiln_map_fill(map, NULL), 0);
    for (uint32_t y = 0; y < 5; y++)
        for (uint32_t x = 0; x < 5; x++)
            for (int p = 0; p < KILN_MAP_PLANES; p++)
                assert_true(map->planes[p][12 * y + x] == (float)(p + 1));
    kiln_map_destroy(&map);
}

static void test_fill_crosses_to_another_chart_when_it_must(void **state)
{
    (void)state;
    struct kiln_map *map = striped_map();
    for (uint32_t i = 0; i < 72; i++)
        if (map->chart[i] == 0)
            map->state[i] = KILN_TEXEL_FILLED;
    assert_int_equal(kiln_map_fill(map, NULL), 0);
    for (uint32_t i = 0; i < 72; i++)
        if (map->chart[i] == 0)
            assert_true(map->planes[0][i] == 9.0f);
    for (uint32_t i = 0; i < 72; i++) /* no valid texel at all: the result is zero */
        if (map->state[i] == KILN_TEXEL_VALID)
            map->state[i] = KILN_TEXEL_FILLED;
    assert_int_equal(kiln_map_fill(map, NULL), 0);
    for (uint32_t i = 0; i < 72; i++)
        assert_true(map->planes[0][i] == 0.0f);
    kiln_map_destroy(&map);
}

static void test_fill_interpolates(void **state)
{
    (void)state;
    struct kiln_map *map = NULL;
    assert_int_equal(kiln_map_create(&map, 3, 1, &kiln_map_light, NULL), 0);
    const float values[3] = {1.0f, 50.0f, 3.0f};
    for (uint32_t i = 0; i < 3; i++) {
        map->state[i] = i == 1 ? KILN_TEXEL_FILLED : KILN_TEXEL_VALID;
        map->chart[i] = 0;
        map->planes[2][i] = values[i];
    }
    assert_int_equal(kiln_map_fill(map, NULL), 0);
    assert_true(map->planes[2][1] == 2.0f);
    kiln_map_destroy(&map);
}

static void test_dilation_covers_the_image(void **state)
{
    (void)state;
    struct kiln_map *map = striped_map();
    uint32_t nearest[72];
    uint64_t dilated = 1;
    assert_int_equal(kiln_nearest_texels(map->state, KILN_TEXEL_FILLED, 12, 6, nearest, NULL), 0);
    assert_int_equal(kiln_map_dilate(map, nearest, &dilated, NULL), 0);
    assert_int_equal(dilated, 2 * 5 + 12);
    for (uint32_t i = 0; i < 72; i++)
        assert_true(map->planes[0][i] == (i % 12 <= 5 ? 1.0f : 9.0f));
    for (uint32_t i = 0; i < 72; i++) /* the states say what was there before */
        assert_int_equal(map->state[i],
                         i % 12 == 5 || i % 12 == 6 || i / 12 == 5 ? KILN_TEXEL_MARGIN : KILN_TEXEL_VALID);
    kiln_map_destroy(&map);
    assert_int_equal(kiln_map_create(&map, 12, 6, &kiln_map_light, NULL), 0);
    assert_int_equal(kiln_nearest_texels(map->state, KILN_TEXEL_FILLED, 12, 6, nearest, NULL), 0);
    assert_int_equal(kiln_map_dilate(map, nearest, &dilated, NULL), 0);
    assert_int_equal(dilated, 0);
    kiln_map_destroy(&map);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_nearest_is_exact), cmocka_unit_test(test_fill_stays_in_the_chart),
        cmocka_unit_test(test_fill_crosses_to_another_chart_when_it_must), cmocka_unit_test(test_fill_interpolates),
        cmocka_unit_test(test_dilation_covers_the_image)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
