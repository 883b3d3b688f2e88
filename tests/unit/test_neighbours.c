/* Sorting of surface points into cells (coordinator/output/map/denoise/neighbours.h). */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <omp.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/output/map/denoise/neighbours.h"
#include "worker/base/memory.h"

enum { COUNT = 60000, THREADS = 5 };

/* A number from 0 to 1 that looks like chance. */
static float chance(uint32_t *state)
{
    *state = *state * 1664525u + 1013904223u;
    return (float)(*state >> 8) * 0x1p-24f;
}

/* Points in a cube of `side` m about the origin, of texels of `levels` sizes; `shuffled`: not by their order. */
static struct kiln_neighbour_point *make_points(float side, int levels, bool shuffled)
{
    struct kiln_neighbour_point *points = NULL;
    uint32_t state = 1;
    assert_int_equal(kiln_allocate(&points, COUNT, sizeof *points, "points", NULL), 0);
    for (uint32_t i = 0; i < COUNT; i++) {
        points[i] = (struct kiln_neighbour_point){.order = shuffled ? (i * 7919u) % COUNT : i, .index = i};
        for (int c = 0; c < 3; c++)
            points[i].position[c] = side * (chance(&state) - 0.5f);
        points[i].size = 0.1f * ldexpf(1.0f + 0.5f * chance(&state), -(int)((float)levels * chance(&state)));
    }
    return points;
}

/* Finds the keys that points are sorted by: level, cell and order. */
static void find_keys(const struct kiln_neighbour_point *point, double keys[5])
{
    int exponent;
    (void)frexpf(point->size, &exponent);
    keys[0] = exponent - 1;
    for (int c = 0; c < 3; c++) {
        const double at = floor(ldexp((double)point->position[c] / 8.0, 1 - exponent));
        keys[1 + c] = fmin(fmax(at, -0x1p30), 0x1p30);
    }
    keys[4] = point->order;
}

/* The first of their keys that differs; 5: none. */
static int compare(const struct kiln_neighbour_point *a, const struct kiln_neighbour_point *b, int *key)
{
    double p[5], q[5];
    find_keys(a, p);
    find_keys(b, q);
    for (*key = 0; *key < 5; ++*key)
        if (p[*key] != q[*key])
            return p[*key] < q[*key] ? -1 : 1;
    return 0;
}

static void check_grid(float side, int levels, bool shuffled, size_t least_cells)
{
    struct kiln_neighbour_point *points = make_points(side, levels, shuffled);
    struct kiln_neighbour_grid *grid = NULL;
    uint8_t *seen = calloc(COUNT, 1);
    assert_non_null(seen);
    assert_int_equal(kiln_neighbour_grid_create(&grid, &points, COUNT, NULL), 0);
    assert_true(grid->cell_count >= least_cells);
    assert_int_equal(grid->first[0], 0);
    assert_int_equal(grid->first[grid->cell_count], COUNT);
    for (size_t i = 0, cell = 0; i < COUNT; i++) {
        int key = 0;
        assert_int_equal(seen[grid->points[i].index]++, 0);
        if (i > 0) {
            assert_int_equal(compare(&grid->points[i - 1], &grid->points[i], &key), -1);
            cell += key < 4;
        }
        assert_true(grid->first[cell] <= i && i < grid->first[cell + 1]);
    }
    free(seen);
    kiln_neighbour_grid_destroy(&grid);
}

static void run(int threads)
{
    const int before = omp_get_max_threads();
    omp_set_num_threads(threads);
    check_grid(40.0f, 1, false, 1000);
    check_grid(40.0f, 5, true, 5000);
    check_grid(1e9f, 3, true, 50000); /* keys of several digits */
    check_grid(1e12f, 1, false, 3);   /* beyond the last cells */
    check_grid(0.0f, 1, true, 1);
    omp_set_num_threads(before);
}

static void points_are_sorted(void **state)
{
    (void)state;
    run(1);
}

static void points_are_sorted_by_threads(void **state)
{
    (void)state;
    run(THREADS);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(points_are_sorted),
                                       cmocka_unit_test(points_are_sorted_by_threads)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
