/* Private to coordinator/surface: what the steps of kiln_surface_build hand on to each other.
 *
 *   points.c   measures objects, finds covered texels and their cells: parts of tiles     (a range of blocks of tiles)
 *   order.c    puts the parts into global order, fills the map: tiles and splits          (those parts; the map of all)
 *   deal.c     cuts the global order between ranks, sends parts to where they belong      (those parts; own tile runs)
 *   share.c    fills pieces and per-point data                                            (own tile runs) */
#ifndef KILN_COORDINATOR_SURFACE_BUILD_H
#define KILN_COORDINATOR_SURFACE_BUILD_H

#include <stdbool.h>

#include "coordinator/surface/cells.h"
#include "coordinator/surface/coverage.h"
#include "coordinator/surface/surface_build.h"

/* Morton-consecutive tiles of an object: what a thread takes at a time, and never two ranks */
enum { KILN_BLOCK_TILES = 512 };

/* The points of a tile in one cell, before they have a place: what becomes a tile run. */
struct kiln_part {
    uint64_t mask;
    uint64_t code;     /* Morton code of the cell */
    uint64_t position; /* among all tile runs in global order */
    uint64_t first;    /* global index of its first point */
    uint32_t tile;
    uint32_t cell; /* index among the occupied cells */
    uint32_t pieces, shares;
};

struct kiln_block {
    struct kiln_part *parts; /* by tile in Morton order */
    size_t count, capacity;
    double area;
    uint64_t shared_texels;
    uint32_t map; /* lightmap */
};

/* What a rank should own whole, cells or lightmaps, with what all ranks found of each. */
struct kiln_units {
    uint64_t count;
    uint64_t *points;         /* unit */
    uint64_t *first_point;    /* count + 1, in global order */
    uint64_t *first_tile_run; /* count + 1, in global order */
};

struct kiln_build {
    const struct kiln_surface_params *params;
    const struct kiln_surface_exchange *exchange; /* never NULL: one with nobody */
    uint32_t workers, worker;                     /* ranks that divide the blocks, and which of them this is */
    const struct kiln_scene *scene;
    const struct kiln_geometry *geometry;
    struct kiln_surface *surface;
    struct kiln_surface_report *report;
    uint32_t threads;
    struct kiln_grid grid;
    uint32_t *vertex_chart;
    double *object_area;         /* m2, of its triangles */
    uint64_t *map_block;         /* lightmap: its first block; one more at the end */
    struct kiln_block *blocks;   /* all; parts are in own ones */
    uint64_t own_first, own_end; /* blocks that this rank covers */
    uint64_t *cell_codes;        /* of the occupied cells, ascending */
    struct kiln_units units;
    /* the first failure of any thread */
    int status;
    struct kiln_error *error;
};

/* Keeps the first failure, or that somebody asked to stop. Thread-safe. */
void kiln_build_fail(struct kiln_build *build, int status, const struct kiln_error *error);
bool kiln_build_failed(struct kiln_build *build);

/* Calls work(build, map, threads) for every lightmap: small ones side by side on one thread each, large ones one after
 * the other on all. `work` reports through kiln_build_fail. Those that `wanted` (NULL: all) marks 0 are left out. */
void kiln_build_for_maps(struct kiln_build *build, const uint8_t *wanted,
                         void (*work)(struct kiln_build *build, uint32_t map, uint32_t threads, const void *context),
                         const void *context);

/* The steps in order, collective. Each returns a status, the same on all ranks, and writes the sentence into
 * build->error. */
int kiln_build_measure(struct kiln_build *build); /* lightmaps, grid, blocks, which are whose */
int kiln_build_cover(struct kiln_build *build);   /* parts of own blocks; areas */
int kiln_build_order(struct kiln_build *build);   /* cells, units, tiles, splits */
int kiln_build_deal(struct kiln_build *build);    /* own tile runs, piece_base, area_cdf_base */
int kiln_build_share(struct kiln_build *build);   /* own points */

/* Points of a part. */
static inline uint64_t kiln_part_points(const struct kiln_part *part)
{
    return (uint64_t)__builtin_popcountll(part->mask);
}

/* How many of `total` points should lie before share r: see kiln_partition_cut. */
static inline uint64_t kiln_partition_ideal(uint64_t total, uint32_t ranks, uint32_t r)
{
    return total / ranks * r + total % ranks * r / ranks;
}

#endif
