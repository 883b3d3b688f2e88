/* Points near a point (coordinator/integrate/land/merge_group.h) against all pairs, where some points look far and
 * others a hundredth as far. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/integrate/land/merge_group.h"

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

static bool is_pair(const struct kiln_merge_place *places, size_t a, size_t b, float part)
{
    const float radius = fminf(looks(&places[a]), looks(&places[b]));
    return a != b && places[b].lit > 0.0f && radius > 0.0f &&
           kiln_merge_are_near(&places[a], &places[b], part * radius);
}

static bool is_in(const uint64_t *mask, size_t i) { return (mask[i / 64] >> i % 64 & 1u) != 0; }

/* Compares the masks of a point with all pairs. Returns how many are near. */
static size_t check_point(const struct kiln_merge_place *places, const struct kiln_merge_group *g, size_t i)
{
    static uint8_t seen[POINTS];
    size_t count = 0;
    memset(seen, 0, sizeof seen);
    for (size_t c = 0; c < 64 * (size_t)g->words; c++) {
        const bool near = is_in(g->near + i * g->words, c), half = is_in(g->half + i * g->words, c);
        assert_true(c < g->candidates || (!near && !half));
        assert_true(near || !half);
        if (!near)
            continue;
        assert_int_equal(seen[g->of[c]], 0);
        seen[g->of[c]] = half ? 2 : 1;
        count++;
    }
    for (size_t b = 0; b < POINTS; b++)
        assert_int_equal(seen[b], is_pair(places, g->points[i], b, 0.5f)   ? 2
                                  : is_pair(places, g->points[i], b, 1.0f) ? 1
                                                                           : 0);
    return count;
}

/* Candidates are in the order of cells and keys of the points' level. */
static void check_order(const struct kiln_merge_grid *grid, const struct kiln_merge_place *places,
                        const struct kiln_merge_group *g)
{
    const int level = kiln_merge_grid_level(grid, places[g->points[0]].widest);
    for (size_t c = 1; c < g->candidates; c++) {
        const struct kiln_merge_place *before = &places[g->of[c - 1]], *now = &places[g->of[c]];
        int64_t first[3], second[3];
        int axis = 2;
        kiln_merge_grid_cell(grid, level, before->position, first);
        kiln_merge_grid_cell(grid, level, now->position, second);
        while (axis >= 0 && first[axis] == second[axis])
            axis--;
        assert_true(axis >= 0 ? first[axis] < second[axis] : before->key < now->key);
    }
}

/* The rings of a point agree with comparisons by each radius. */
static void check_rings(struct kiln_merge_finder *finder, const struct kiln_merge_place *places,
                        const struct kiln_merge_group *g, size_t i)
{
    float radii[KILN_MERGE_RINGS];
    const struct kiln_merge_place *place = &places[g->points[i]];
    for (int k = 0; k < KILN_MERGE_RINGS; k++)
        radii[k] = looks(place) * exp2f(-0.5f * (float)(KILN_MERGE_RINGS - k));
    const size_t near = kiln_merge_group_rings(finder, g, i, place, radii);
    for (size_t n = 0; n < near; n++) {
        uint32_t within = 0;
        assert_true(is_in(g->near + i * g->words, finder->which[n]));
        for (int k = 0; k < KILN_MERGE_RINGS; k++)
            within += kiln_merge_are_near(place, &places[g->of[finder->which[n]]], radii[k]);
        assert_int_equal(finder->within[n], within);
    }
}

struct found {
    size_t groups, near, narrow;
};

/* Checks all groups of all chunks. */
static void check_all(const struct kiln_merge_grid *grid, const struct kiln_merge_place *places, struct found *found)
{
    struct kiln_merge_finder finder = {.words = NULL};
    struct kiln_error error = {""};
    for (size_t first = 0; first < POINTS; first += KILN_MERGE_CHUNK) {
        uint64_t rest = 0;
        for (size_t i = 0; i < KILN_MERGE_CHUNK && first + i < POINTS; i++)
            rest |= (uint64_t)(places[first + i].lit > 0.0f) << i;
        while (rest != 0) {
            uint32_t points[KILN_MERGE_CHUNK];
            struct kiln_merge_group group, copy;
            size_t words;
            const uint32_t count = kiln_merge_group_choose(grid, places, first, &rest, points);
            assert_in_range(count, 1, KILN_MERGE_CHUNK);
            assert_int_equal(
                kiln_merge_group_find(grid, places, points, count, RADIUS, &finder, &group, &words, &error), KILN_OK);
            assert_ptr_equal(kiln_merge_group_read(finder.words, &copy), finder.words + words);
            assert_int_equal(copy.count, count);
            check_order(grid, places, &group);
            for (uint32_t i = 0; i < count; i++) {
                assert_int_equal(group.points[i], points[i]);
                found->near += check_point(places, &group, i);
                found->narrow += looks(&places[points[i]]) < 0.5f * RADIUS;
                check_rings(&finder, places, &group, i);
            }
            found->groups++;
        }
    }
    kiln_merge_finder_release(&finder);
}

static void test_all_pairs(void **state)
{
    (void)state;
    static struct kiln_merge_place places[POINTS];
    struct kiln_merge_grid *grid = NULL;
    struct kiln_error error = {""};
    struct found found = {0}, narrowed = {0};
    scatter(places);
    assert_int_equal(kiln_merge_grid_create(&grid, places, POINTS, RADIUS, 2, &error), KILN_OK);
    check_all(grid, places, &found);
    assert_true(found.narrow > POINTS / 5 && found.near > POINTS);
    for (size_t i = 0; i < POINTS; i += 7)
        places[i].widest = i % 70 == 0 ? 0.0f : 0.4f * looks(&places[i]);
    check_all(grid, places, &narrowed);
    assert_true(narrowed.near > POINTS && narrowed.near < found.near);
    kiln_merge_grid_destroy(&grid);
    assert_null(grid);
}

/* Points in order stand together, and so are searched for together. */
static void test_groups(void **state)
{
    (void)state;
    static struct kiln_merge_place places[POINTS];
    struct kiln_merge_grid *grid = NULL;
    struct kiln_error error = {""};
    struct found found = {0};
    for (size_t i = 0; i < POINTS; i++)
        places[i] = (struct kiln_merge_place){.key = i,
                                              .position = vec3((float)(i % 8), (float)(i / 8), 0.0f),
                                              .normal = vec3(0.0f, 0.0f, 1.0f),
                                              .lit = 1.0f,
                                              .widest = INFINITY};
    for (size_t i = 0; i < POINTS; i++)
        places[i].position = vec3_scale(places[i].position, RADIUS / 6.0f);
    assert_int_equal(kiln_merge_grid_create(&grid, places, POINTS, RADIUS, 1, &error), KILN_OK);
    check_all(grid, places, &found);
    assert_int_equal(found.groups, (POINTS + KILN_MERGE_CHUNK - 1) / KILN_MERGE_CHUNK);
    kiln_merge_grid_destroy(&grid);
}

static void test_no_grid(void **state)
{
    (void)state;
    static const struct kiln_merge_place places[KILN_MERGE_CHUNK];
    struct kiln_merge_finder finder = {.words = NULL};
    struct kiln_merge_group group;
    struct kiln_error error = {""};
    uint32_t points[KILN_MERGE_CHUNK];
    uint64_t rest = 5;
    size_t words;
    assert_int_equal(kiln_merge_group_choose(NULL, places, 0, &rest, points), 2);
    assert_int_equal(rest, 0);
    assert_int_equal(kiln_merge_group_find(NULL, places, points, 2, 1.0f, &finder, &group, &words, &error), KILN_OK);
    assert_int_equal(group.count, 2);
    assert_int_equal(group.points[1], 2);
    assert_int_equal(group.candidates, 0);
    kiln_merge_finder_release(&finder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_all_pairs), cmocka_unit_test(test_groups),
                                       cmocka_unit_test(test_no_grid)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
