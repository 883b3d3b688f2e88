/* Private to coordinator/surface: what the steps of kiln_surface_build hand on to each other.
 *
 *   points.c   measures objects, finds covered texels and their cells: parts of tiles     (all objects, every rank)
 *   order.c    puts the parts into global order, cuts it between ranks, fills tiles       (all objects, every rank)
 *   share.c    fills pieces and per-point data                                            (own fragments) */
#ifndef KILN_COORDINATOR_SURFACE_BUILD_H
#define KILN_COORDINATOR_SURFACE_BUILD_H

#include <stdbool.h>

#include "coordinator/surface/cells.h"
#include "coordinator/surface/coverage.h"
#include "coordinator/surface/surface_build.h"

enum { KILN_BLOCK_TILES = 512 }; /* Morton-consecutive tiles of an object that one thread takes at a time */

/* The points of a tile in one cell, before they have a place: what becomes a fragment. */
struct kiln_part {
    uint64_t mask;
    uint64_t code;     /* Morton code of the cell */
    uint64_t position; /* among all fragments in global order */
    uint64_t first;    /* global index of its first point */
    uint32_t tile;
    uint32_t cell;     /* index among the occupied cells */
    uint32_t pieces, shares;
};

struct kiln_block {
    struct kiln_part *parts; /* by tile in Morton order */
    size_t count, capacity;
    double area;
    uint64_t shared_texels;
    uint32_t object;
};

struct kiln_build {
    const struct kiln_surface_params *params;
    const struct kiln_scene *scene;
    const struct kiln_geometry *geometry;
    struct kiln_surface *surface;
    struct kiln_surface_report *report;
    uint32_t threads;
    struct kiln_grid grid;
    uint32_t *vertex_chart;
    double *object_area; /* m2, of its triangles */
    uint64_t *object_block; /* object: its first block; one more at the end */
    struct kiln_block *blocks;
    uint64_t *cell_codes; /* of the occupied cells, ascending */
    /* the first failure of any thread */
    int status;
    struct kiln_error *error;
};

/* Keeps the first failure. Thread-safe. */
void kiln_build_fail(struct kiln_build *build, int status, const struct kiln_error *error);
bool kiln_build_failed(struct kiln_build *build);

/* Calls work(build, object, threads) for every object: small ones side by side on one thread each, large ones one after the
 * other on all. `work` reports through kiln_build_fail. Objects that `wanted` (NULL: all) marks 0 are left out. */
void kiln_build_for_objects(struct kiln_build *build, const uint8_t *wanted,
                            void (*work)(struct kiln_build *build, uint32_t object, uint32_t threads, const void *context),
                            const void *context);

/* The steps in order. Each returns a status and writes the sentence into build->error. */
int kiln_build_measure(struct kiln_build *build); /* lightmaps, areas, grid, blocks */
int kiln_build_cover(struct kiln_build *build);   /* parts */
int kiln_build_order(struct kiln_build *build);   /* cells, tiles, own fragments, piece_base, share_base */
int kiln_build_share(struct kiln_build *build);   /* own points */

#endif
