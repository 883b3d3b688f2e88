/* Means over neighbouring tiles (coordinator/integrate/parts/tile_pool.h). */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <mpi.h>

#include "coordinator/integrate/parts/tile_pool.h"

enum { SIDE = 4, RUNS = SIDE * SIDE + 2 };

/* A lightmap of 4 x 4 tiles, whose first tile has two runs, and a second lightmap of one tile. */
struct scene {
    struct kiln_lightmap maps[2];
    struct kiln_tile_run runs[RUNS];
    struct kiln_surface surface;
    struct kiln_integrate_settings settings;
    struct kiln_integrate_params params;
    uint32_t weights[RUNS];
    double values[RUNS];
};

static void make(struct scene *s)
{
    *s = (struct scene){
        .maps = {{.tiles_x = SIDE, .tiles_y = SIDE}, {.tile_first = SIDE * SIDE, .tiles_x = 1, .tiles_y = 1}}};
    for (uint32_t i = 0; i < RUNS; i++) {
        s->runs[i] = (struct kiln_tile_run){.tile = i <= SIDE * SIDE ? i - (i > 0) : 0, .map = i == RUNS - 1};
        s->weights[i] = 1;
    }
    s->surface = (struct kiln_surface){
        .lightmaps = s->maps, .tile_runs = s->runs, .tile_run_count = RUNS, .tile_count = SIDE * SIDE + 1};
    s->params = (struct kiln_integrate_params){.communicator = MPI_COMM_SELF, .settings = &s->settings};
}

static void pool(struct scene *s, double most)
{
    struct kiln_error error;
    assert_int_equal(kiln_tile_pool(&s->params, &s->surface, most, s->weights, s->values, &error), KILN_OK);
}

/* One lucky tile spreads over nine; other lightmaps have no part in it; both runs of a tile get the same. */
static void means_of_neighbours(void **state)
{
    struct scene s;
    (void)state;
    make(&s);
    s.values[6] = 9.0; /* tile 5: second of the second row */
    s.values[RUNS - 1] = 4.0;
    pool(&s, 1000.0);
    assert_true(fabs(s.values[6] - 9.0 / 10.0) <= 1e-9); /* nine tiles, of which one has two runs */
    assert_true(fabs(s.values[0] - 9.0 / 5.0) <= 1e-9);
    assert_true(s.values[1] == s.values[0]);
    assert_true(fabs(s.values[11] - 9.0 / 9.0) <= 1e-9); /* tile 10: without the first */
    assert_true(fabs(s.values[16] - 0.0) <= 1e-9);       /* tile 15, two away */
    assert_true(fabs(s.values[RUNS - 1] - 4.0) <= 1e-9);
}

/* Weights count, values above the most count as that, and where nothing weighs values stay. */
static void weights_and_limits(void **state)
{
    struct scene s;
    (void)state;
    make(&s);
    for (int i = 0; i < RUNS; i++)
        s.weights[i] = 0;
    s.weights[6] = 3;
    s.weights[7] = 1;
    s.values[6] = 2.0;
    s.values[7] = 1e30;
    s.values[16] = 7.0;
    pool(&s, 10.0);
    assert_true(fabs(s.values[6] - (3 * 2.0 + 10.0) / 4.0) <= 1e-9);
    assert_true(fabs(s.values[0] - 2.0) <= 1e-9); /* tile 0 has no weight of its own, and tile 6 is not beside it */
    assert_true(fabs(s.values[16] - 7.0) <= 1e-9);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(means_of_neighbours), cmocka_unit_test(weights_and_limits)};
    (void)MPI_Init(&argc, &argv);
    const int failed = cmocka_run_group_tests(tests, NULL, NULL);
    (void)MPI_Finalize();
    return failed;
}
