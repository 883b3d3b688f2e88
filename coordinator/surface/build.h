/* Private to coordinator/surface: the state that the steps of kiln_surface_build pass to one another. Each step reads
 * what the steps before it left and adds its own.
 *
 *   bricks.c        the bricks of octrees
 *   points.c        lightmap sizes, ranges of tiles; covers the ranges of this rank: unplaced runs
 *   order.c         gives the unplaced runs their places in the global order; fills the map of all tiles on every rank
 *   assignment.c    splits the global order between the ranks and sends each tile run to the rank that owns it
 *   rank_surface.c  fills this rank's arrays: pieces, area, albedo of its own points */
#ifndef KILN_COORDINATOR_SURFACE_BUILD_H
#define KILN_COORDINATOR_SURFACE_BUILD_H

#include <stdbool.h>

#include "coordinator/surface/cells.h"
#include "coordinator/surface/coverage.h"
#include "coordinator/surface/surface_build.h"

/* Tiles of one lightmap that follow one another in Morton order. A range is covered by one thread of one rank. */
enum { KILN_RANGE_TILES = 512 };

/* The points of one tile in one cell, before their place in the global order is known. Each becomes a tile run. */
struct kiln_unplaced_run {
    uint64_t mask;     /* its texels, by bit (kiln_morton8) */
    uint64_t code;     /* Morton code of the cell */
    uint64_t position; /* index among all tile runs in global order; set by kiln_build_order */
    uint64_t first;    /* global index of its first point; set by kiln_build_order */
    uint32_t tile;
    uint32_t cell;                /* index among the occupied cells */
    uint32_t pieces, cdf_entries; /* how many entries it needs in the surface's arrays */
};

struct kiln_tile_range {
    struct kiln_unplaced_run *runs; /* by tile in Morton order; within a tile by first point */
    size_t count, capacity;
    double area;
    uint64_t overlapped_texels;
    uint32_t map; /* number of its lightmap */
};

/* The units of the partition: cells or, with KILN_PARTITION_OBJECTS, lightmaps. A rank should own whole units. The
 * counts are those of all ranks together. */
struct kiln_units {
    uint64_t count;
    uint64_t *points; /* one per unit */
    /* one per unit, and one more at the end: where the unit begins in the global order */
    uint64_t *first_point, *first_tile_run;
};

struct kiln_build {
    const struct kiln_surface_params *params;
    /* never NULL; a process that works alone has one that exchanges nothing */
    const struct kiln_surface_exchange *exchange;
    /* number of ranks that divide the ranges between them, and this rank's number among these */
    uint32_t workers, worker;
    const struct kiln_scene *scene;
    const struct kiln_geometry *geometry;
    struct kiln_surface *surface;
    struct kiln_surface_report *report;
    uint32_t threads;
    struct kiln_grid grid;
    uint32_t *vertex_chart;
    double *object_area;                 /* one per object: m2, sum of its triangles */
    uint64_t *map_range;                 /* one per lightmap, and one more at the end: its first range */
    struct kiln_tile_range *tile_ranges; /* the ranges of all ranks; only those of this rank have runs */
    uint64_t own_first, own_end;         /* ranges that this rank covers */
    uint64_t *cell_codes;                /* Morton codes of the occupied cells, ascending */
    struct kiln_units units;
    struct kiln_texture_means **means; /* one per material, some shared or NULL; used by kiln_build_fill */
    uint32_t *owners;                  /* the first material of each distinct mean: `owner_count` */
    size_t owner_count;
    /* the first failure of any thread; KILN_OK: none */
    int status;
    struct kiln_error *error;
};

/* Keeps the first failure of any thread. Thread-safe. */
void kiln_build_fail(struct kiln_build *build, int status, const struct kiln_error *error);
/* Tells whether a thread has failed. A stop request of the user becomes a failure (KILN_STOPPED). Thread-safe. */
bool kiln_build_failed(struct kiln_build *build);

/* Calls work(build, map, threads) for every lightmap. Small lightmaps are processed in parallel, on one thread each;
 * large ones one after the other, each on all threads. `work` reports failures through kiln_build_fail. `wanted` (NULL:
 * all) is 0 for lightmaps to leave out. */
void kiln_build_for_maps(struct kiln_build *build, const uint8_t *wanted,
                         void (*work)(struct kiln_build *build, uint32_t map, uint32_t threads, const void *context),
                         const void *context);

/* The steps, in order. All are collective over the ranks of the exchange, return the same status on all of them, and
 * write the sentence into build->error. */
/* lightmap sizes, grid of cells, ranges and their division between the ranks */
int kiln_build_measure(struct kiln_build *build);
int kiln_build_cover(struct kiln_build *build);  /* unplaced runs of this rank's ranges; areas of all */
int kiln_build_order(struct kiln_build *build);  /* occupied cells, units, global order, tiles and splits */
int kiln_build_assign(struct kiln_build *build); /* this rank's range: tile_runs, piece_base, area_cdf_base */
/* piece_count, pieces, area_cdf, albedo, area, visible of this rank's points */
int kiln_build_fill(struct kiln_build *build);

static inline uint64_t kiln_unplaced_run_points(const struct kiln_unplaced_run *run)
{
    return (uint64_t)__builtin_popcountll(run->mask);
}

/* The number of points, of `total`, that should lie before rank r's range: r / ranks of them, without overflow. */
static inline uint64_t kiln_partition_ideal(uint64_t total, uint32_t ranks, uint32_t r)
{
    return total / ranks * r + total % ranks * r / ranks;
}

#endif
