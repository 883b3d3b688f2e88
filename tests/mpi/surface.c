/* Test of the surface, run by mpirun on eight ranks: 1, 2, 3, 5 and 8 of them build a surface together, and each holds
 * bit for bit what a single process computes for the same range of points; if one rank fails, all do. Scenes have more
 * blocks of tiles than ranks, fewer, and one. */
#include <mpi.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/bake/points/surface_exchange.h"
#include "tests/unit/surface_scene.h"

enum { WORLD = 8 };

static struct fixture *scene(int objects)
{
    static const double transforms[3][12] = {{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0},
                                             {-1, 0.3, 0, 5, 0, 2, 0, -1, 0.1, 0, 0.5, 2},
                                             {0, -3, 0, 20, 3, 0, 0, 7, 0, 0, 3, -9}};
    static const uint32_t sizes[3][2] = {{7, 5}, {420, 400}, {130, 260}};
    struct fixture *f = fixture_create();
    const uint32_t grey = fixture_material(f, 0.5f, 0.25f, 0.75f);
    const uint32_t coarse = fixture_cube(f, 3, 0.5, grey), dense = fixture_cube(f, 16, 0.5, grey);
    for (int i = 0; i < objects; i++)
        fixture_object(f, i == 1 ? dense : coarse, transforms[i], sizes[i][0], sizes[i][1]);
    return f;
}

/* 1 and a sentence when the arrays differ. */
static int differs(const char *what, const void *a, const void *b, size_t count, size_t size)
{
    if (count == 0 || memcmp(a, b, count * size) == 0)
        return 0;
    (void)fprintf(stderr, "%s differ\n", what);
    return 1;
}

#define DIFFERS(member, count) differs(#member, a->member, b->member, count, sizeof *a->member)

static int compare(const struct kiln_surface *a, const struct kiln_surface *b, size_t objects)
{
    if (a->point_count != b->point_count || a->tile_count != b->tile_count || a->split_count != b->split_count ||
        a->cell_count != b->cell_count || a->first.at != b->first.at || a->count != b->count ||
        a->tile_run_count != b->tile_run_count) {
        (void)fprintf(stderr, "points %llu to %llu differ in number\n", (unsigned long long)a->first.at,
                      (unsigned long long)(a->first.at + a->count));
        return 1;
    }
    const size_t tile_runs = a->tile_run_count;
    return DIFFERS(tiles, a->tile_count) + DIFFERS(splits, a->split_count) + DIFFERS(lightmaps, objects) +
           ((a->cell_first == NULL) != (b->cell_first == NULL)) +
           DIFFERS(cell_first, a->cell_first == NULL ? 0 : a->cell_count + 1) + DIFFERS(tile_runs, tile_runs) +
           DIFFERS(piece_base, tile_runs + 1) + DIFFERS(area_cdf_base, tile_runs + 1) + DIFFERS(piece_count, a->count) +
           DIFFERS(pieces, a->piece_base[tile_runs]) + DIFFERS(area_cdf, a->area_cdf_base[tile_runs]) +
           DIFFERS(albedo, 3 * a->count) + DIFFERS(area, a->count) + DIFFERS(visible, a->count);
}

static int build_both(MPI_Comm communicator, struct kiln_surface_params params, size_t limit)
{
    struct kiln_surface_meeting meeting = {communicator, limit};
    const struct kiln_surface_exchange exchange = kiln_surface_exchange_over(&meeting);
    struct kiln_surface *together = NULL, *alone = NULL;
    struct kiln_surface_report reports[2];
    struct kiln_error error = {""};
    int failures = 1;
    if (kiln_surface_build(&alone, &params, &reports[0], &error) == KILN_OK) {
        params.exchange = &exchange;
        if (kiln_surface_build(&together, &params, &reports[1], &error) == KILN_OK)
            failures = compare(together, alone, params.scene->object_count) +
                       differs("reports", &reports[0], &reports[1], 1, sizeof *reports);
    }
    if (error.message[0] != 0)
        (void)fprintf(stderr, "%s\n", error.message);
    kiln_surface_destroy(&together);
    kiln_surface_destroy(&alone);
    return failures;
}

/* The last rank asks for what cannot be. */
static int fail_together(MPI_Comm communicator, struct kiln_surface_params params)
{
    struct kiln_surface_meeting meeting = {communicator, 0};
    const struct kiln_surface_exchange exchange = kiln_surface_exchange_over(&meeting);
    struct kiln_surface *surface = NULL;
    struct kiln_surface_report report;
    struct kiln_error error = {""};
    params.exchange = &exchange;
    params.cell_size = params.rank + 1 == params.ranks ? -1.0 : 0.0;
    const int status = kiln_surface_build(&surface, &params, &report, &error);
    if (status == KILN_BAD_INPUT && surface == NULL && strstr(error.message, "-1 is not a length") != NULL)
        return 0;
    (void)fprintf(stderr, "rank %u got %d, \"%s\"\n", params.rank, status, error.message);
    kiln_surface_destroy(&surface);
    return 1;
}

static int try_scene(MPI_Comm communicator, int objects)
{
    static const double sizes[] = {0.0, 2.5};
    const size_t limits[] = {0, objects == 1 ? 1 : 5000}; /* a record at a time where there are few */
    struct fixture *f = scene(objects);
    struct kiln_geometry *geometry = NULL;
    int rank, ranks, failures = kiln_geometry_create(&geometry, &f->scene, NULL) != KILN_OK;
    (void)MPI_Comm_rank(communicator, &rank);
    (void)MPI_Comm_size(communicator, &ranks);
    for (int i = 0; i < 4 && failures == 0; i++) {
        const struct kiln_surface_params params = {.scene = &f->scene,
                                                   .geometry = geometry,
                                                   .cell_size = sizes[i / 2],
                                                   .partition =
                                                       i % 2 == 0 ? KILN_PARTITION_CELLS : KILN_PARTITION_OBJECTS,
                                                   .rank = (uint32_t)rank,
                                                   .ranks = (uint32_t)ranks,
                                                   .threads = 1 + (uint32_t)rank % 2};
        failures += build_both(communicator, params, limits[i / 2]);
        if (i == 0)
            failures += fail_together(communicator, params);
        if (failures > 0)
            (void)fprintf(stderr, "rank %d of %d, %d objects, cells of %g m, partition %d\n", rank, ranks, objects,
                          params.cell_size, i % 2);
        (void)MPI_Allreduce(MPI_IN_PLACE, &failures, 1, MPI_INT, MPI_SUM, communicator);
    }
    kiln_geometry_destroy(&geometry);
    fixture_destroy(f);
    return failures;
}

int main(int argc, char **argv)
{
    static const int counts[] = {1, 2, 3, 5, WORLD};
    int rank = 0, size = 0, failures = 0, total = 0;
    MPI_Init(&argc, &argv);
    MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    MPI_Comm_size(MPI_COMM_WORLD, &size);
    if (size != WORLD) {
        (void)fprintf(stderr, "this test wants %d ranks, not %d\n", WORLD, size);
        MPI_Abort(MPI_COMM_WORLD, 1);
    }
    for (size_t i = 0; i < sizeof counts / sizeof counts[0]; i++) {
        MPI_Comm some;
        MPI_Comm_split(MPI_COMM_WORLD, rank < counts[i] ? 0 : MPI_UNDEFINED, 0, &some);
        if (some == MPI_COMM_NULL)
            continue;
        for (int objects = 1; objects <= 3; objects++)
            failures += try_scene(some, objects);
        MPI_Comm_free(&some);
    }
    MPI_Allreduce(&failures, &total, 1, MPI_INT, MPI_SUM, MPI_COMM_WORLD);
    MPI_Finalize();
    return total != 0;
}
