/* Points near a point (coordinator/integrate/land/merge_near.h) against all pairs, where some points look far and
 * others a hundredth as far. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdlib.h>

#include "coordinator/integrate/land/merge_near.h"
#include "worker/base/memory.h"

enum { POINTS = 5000 }; /* more than one thread sorts */
#define RADIUS 0.25f

static float next(uint64_t *state)
{
    *state = *state * 6364136223846793005u + 1442695040888963407u;
    return (float)(*state >> 40) * 0x1p-24f;
}

/* On two floors and a wall. A third of the points have a radius of their own, 0 of some; a tenth takes no part. */
static void scatter(struct kiln_merge_place *places)
{
    uint64_t state = 20261124;
    for (size_t i = 0; i < POINTS; i++) {
        const float x = next(&state), y = next(&state);
        struct kiln_merge_place *p = &places[i];
        *p = (struct kiln_merge_place){.key = (uint64_t)(POINTS - i), .lit = i % 10 == 9 ? 0.0f : 1.0f};
        p->position = i % 3 == 2 ? vec3(0.0f, x, y) : vec3(x, y, i % 3 == 1 ? 0.02f : 0.0f);
        p->normal = i % 3 == 2 ? vec3(1.0f, 0.0f, 0.0f) : vec3(0.0f, 0.0f, 1.0f);
        p->widest = i % 30 == 12 ? 0.0f : i % 3 == 0 ? RADIUS * exp2f(-9.0f * next(&state)) : INFINITY;
    }
}

static float looks(const struct kiln_merge_place *p) { return fminf(RADIUS, p->widest); }

static size_t count_pairs(const struct kiln_merge_place *places, size_t at)
{
    size_t count = 1;
    for (size_t i = 0; i < POINTS; i++)
        count += i != at && places[i].lit > 0.0f && places[i].widest > 0.0f &&
                 kiln_merge_are_near(&places[at], &places[i], fminf(looks(&places[at]), looks(&places[i])));
    return count;
}

static void test_all_pairs(void **state)
{
    (void)state;
    static struct kiln_merge_place places[POINTS];
    struct kiln_merge_grid *grid = NULL;
    struct kiln_merge_near near = {0};
    struct kiln_error error = {""};
    size_t narrow = 0, found = 0;
    scatter(places);
    assert_int_equal(kiln_merge_grid_create(&grid, places, POINTS, RADIUS, 2, &error), KILN_OK);
    for (size_t at = 0; at < POINTS; at++) {
        if (!(places[at].lit > 0.0f))
            continue;
        assert_int_equal(kiln_merge_grid_find(grid, at, looks(&places[at]), &near, &error), KILN_OK);
        assert_int_equal(near.of[0], at);
        assert_int_equal(near.count, count_pairs(places, at));
        narrow += looks(&places[at]) < 0.5f * RADIUS;
        found += near.count - 1;
        for (size_t i = 1; i < near.count; i++) {
            assert_true(places[near.of[i]].lit > 0.0f);
            const struct kiln_merge_place *other = &places[near.of[i]];
            assert_true(kiln_merge_are_near(&places[at], other, fminf(looks(&places[at]), looks(other))));
        }
    }
    assert_true(narrow > POINTS / 5 && found > POINTS);
    kiln_free(&near.of);
    kiln_merge_grid_destroy(&grid);
    assert_null(grid);
}

static void test_no_grid(void **state)
{
    (void)state;
    struct kiln_merge_near near = {0};
    struct kiln_error error = {""};
    assert_int_equal(kiln_merge_grid_find(NULL, 7, 1.0f, &near, &error), KILN_OK);
    assert_int_equal(near.count, 1);
    assert_int_equal(near.of[0], 7);
    kiln_free(&near.of);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_all_pairs), cmocka_unit_test(test_no_grid)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
