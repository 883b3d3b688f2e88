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

/* ---- kept neighbours ---- */

/* Points on a sphere, in directions by chance; texels are 0.08 to 0.12 m large. */
static struct kiln_neighbour_grid *make_sphere(float radius)
{
    struct kiln_neighbour_point *points = make_points(2.0f, 1, false);
    struct kiln_neighbour_grid *grid = NULL;
    uint32_t chances = 7;
    for (uint32_t i = 0; i < COUNT; i++) {
        float *p = points[i].position, length = 0.0f;
        for (int c = 0; c < 3; c++)
            length += p[c] * p[c];
        for (int c = 0; c < 3; c++) {
            points[i].normal[c] = p[c] / sqrtf(length);
            p[c] = radius * points[i].normal[c];
        }
        points[i].size = 0.08f + 0.04f * chance(&chances);
        points[i].area = points[i].size * points[i].size;
    }
    assert_int_equal(kiln_neighbour_grid_create(&grid, &points, COUNT, NULL), 0);
    return grid;
}

static void check_same(const struct kiln_neighbours *a, const struct kiln_neighbours *b, size_t rings)
{
    const size_t count = a->within[rings - 1];
    assert_memory_equal(a->within, b->within, rings * sizeof *a->within);
    assert_memory_equal(a->place, b->place, count * sizeof *a->place);
    assert_memory_equal(a->x, b->x, count * sizeof *a->x);
    assert_memory_equal(a->y, b->y, count * sizeof *a->y);
    assert_memory_equal(a->area, b->area, count * sizeof *a->area);
}

/* Checks the neighbours of all places in `rings` rings against a search; returns how many cells were kept. */
static size_t check_kept(const struct kiln_neighbour_grid *grid, const struct kiln_neighbours_kept *kept, size_t rings)
{
    const float radius = kiln_neighbour_rings[rings - 1];
    struct kiln_neighbours *n = NULL, *searched = NULL;
    size_t cells = 0;
    assert_int_equal(kiln_allocate(&n, 1, sizeof *n, "neighbours", NULL), 0);
    assert_int_equal(kiln_allocate(&searched, 1, sizeof *searched, "neighbours", NULL), 0);
    for (size_t cell = 0; cell < grid->cell_count; cell++) {
        cells += kept->cells[cell] != NULL;
        kiln_neighbours_collect_kept(n, grid, kept, cell, radius);
        kiln_neighbours_collect(searched, grid, cell, radius);
        for (size_t place = grid->first[cell]; place < grid->first[cell + 1]; place++) {
            kiln_neighbours_find(n, grid, place, radius);
            kiln_neighbours_find(searched, grid, place, radius);
            check_same(n, searched, rings);
        }
    }
    kiln_free(&n);
    kiln_free(&searched);
    return cells;
}

static void keep_all(const struct kiln_neighbour_grid *grid, struct kiln_neighbours_kept *kept, size_t most)
{
    struct kiln_neighbours *n = NULL;
    assert_int_equal(kiln_allocate(&n, 1, sizeof *n, "neighbours", NULL), 0);
    assert_int_equal(kiln_neighbours_kept_create(kept, grid, most, NULL), 0);
    for (size_t cell = 0; cell < grid->cell_count; cell++) {
        kiln_neighbours_collect_kept(n, grid, kept, cell, KILN_NEIGHBOUR_RADIUS);
        for (size_t place = grid->first[cell]; place < grid->first[cell + 1]; place++)
            kiln_neighbours_find(n, grid, place, KILN_NEIGHBOUR_RADIUS);
        kiln_neighbours_keep(n, kept, cell);
    }
    kiln_free(&n);
}

/* Kept neighbours are those that a search finds, to the bit; what does not fit is searched again. Spheres have their
 * points closely by, so that cells have many candidates, or far. */
static void kept_neighbours_are_the_same(void **state)
{
    const struct {
        float radius;
        size_t most;
        bool all, none;
    } cases[] = {{6.0f, SIZE_MAX, true, false},
                 {6.0f, 1 << 20, false, false},
                 {6.0f, 0, false, true},
                 {1.5f, SIZE_MAX, false, false}};
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct kiln_neighbour_grid *grid = make_sphere(cases[i].radius);
        struct kiln_neighbours_kept kept;
        keep_all(grid, &kept, cases[i].most);
        const size_t cells = check_kept(grid, &kept, KILN_NEIGHBOUR_RINGS);
        assert_int_equal(check_kept(grid, &kept, 5), cells);
        assert_true(!cases[i].all || cells == grid->cell_count);
        assert_true(cases[i].none ? cells == 0 : cases[i].all || cells < grid->cell_count);
        kiln_neighbours_kept_release(&kept);
        kiln_neighbour_grid_destroy(&grid);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(points_are_sorted),
                                       cmocka_unit_test(points_are_sorted_by_threads),
                                       cmocka_unit_test(kept_neighbours_are_the_same)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
