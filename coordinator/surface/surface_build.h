/* From lightmap layouts to surface points, cells and a partition. */
#ifndef KILN_COORDINATOR_SURFACE_SURFACE_BUILD_H
#define KILN_COORDINATOR_SURFACE_SURFACE_BUILD_H

#include <stdbool.h>
#include <stdint.h>

#include "worker/base/stop.h"
#include "worker/scene/surface.h"

enum kiln_partition { KILN_PARTITION_CELLS = 0, KILN_PARTITION_OBJECTS = 1 };

/* Records of one kind, some of all there are; they are only lent. */
typedef void (*kiln_surface_taker)(void *taker, const void *records, size_t count);

/* How the ranks that build a surface together speak with one another. All functions are collective, with the same
 * `size` and meaning of records on all ranks. Each rank brings how it stands: where one's `status` is not KILN_OK,
 * nothing is exchanged and all return the worst and hold its sentence; and so they all do when one fails inside. */
struct kiln_surface_exchange {
    void *context;
    int (*agree)(void *context, int status, struct kiln_error *error);
    /* values[i] becomes the sum of all ranks' ones; before[i] (before may be NULL) that of the ranks before this one.
     */
    int (*sum)(void *context, int status, uint64_t *values, uint64_t *before, size_t count, struct kiln_error *error);
    /* Hands the records of all ranks, its own among them, to `take` on every rank: in calls of some at a time, in any
     * order. */
    int (*all)(void *context, int status, const void *own, size_t count, size_t size, kiln_surface_taker take,
               void *taker, struct kiln_error *error);
    /* Hands each rank the records for it: of `own` the first counts[0] are for rank 0, the next counts[1] for rank 1;
     * none for itself. */
    int (*deal)(void *context, int status, const void *own, const size_t *counts, size_t size, kiln_surface_taker take,
                void *taker, struct kiln_error *error);
};

struct kiln_surface_params {
    const struct kiln_scene *scene;       /* borrowed during the call */
    const struct kiln_geometry *geometry; /* borrowed during the call */
    /* m; 0: chosen from the scene alone, never from the number of ranks: a 24th of the longest side, doubled until an
     * occupied cell holds 1024 points on the mean */
    double cell_size;
    enum kiln_partition partition;
    /* lightmaps of backs are published, and as fine as those of fronts, of all objects */
    bool both_sides;
    uint32_t rank, ranks; /* whose share is wanted */
    /* between all `ranks`, which then divide the work; NULL: this one does it alone */
    const struct kiln_surface_exchange *exchange;
    uint32_t threads;             /* 0: all */
    const struct kiln_stop *stop; /* borrowed; NULL: none. KILN_STOPPED then, on all ranks */
};

/* What was found, the same on all ranks but for `own_*`. Shares are 0..1. */
struct kiln_surface_report {
    uint64_t points, texels; /* of fronts and backs */
    uint64_t back_points;
    uint64_t cells_occupied, cells_total;
    double cell_size;  /* m */
    uint64_t cells[3]; /* grid */
    uint64_t tile_runs;
    double area;                    /* m2, sum of the areas of all points of fronts */
    double geometry_area;           /* m2, sum of all triangles' areas */
    double worst_object_area_error; /* largest |sum of texel areas / surface area - 1| over objects with area */
    uint32_t worst_object;
    uint64_t shared_texels;          /* texels that pieces of more than one chart share */
    double imbalance;                /* largest share / mean share - 1, in points */
    uint64_t points_min, points_max; /* over ranks */
};

/* Builds the surface: the same global part on all ranks, and a rank's share of the rest. With an exchange it is
 * collective over its ranks and gives all the same status: each finds the points of a part of all lightmap tiles (equal
 * in estimated work, whatever share will be its own), they add up how many lie in each cell, so that each can number
 * its own, and tell all where tiles' points begin, and the owners what their tile runs are. No rank holds more of the
 * others' than that map. Without one, a single process finds the points of the whole scene, whatever `ranks` is. Both
 * give the same bits.
 *
 * Coverage is conservative: a texel that a triangle touches with non-zero area is a point even if its centre is not on
 * one. Each triangle is clipped to each texel it touches (worker/scene/clip.h), so that areas are exact. Triangles
 * without area in the world have no points; one without area in the lightmap alone belongs wholly to the texel of its
 * centroid there. A texel that triangles of several charts touch keeps all their pieces. Pieces stand in order of world
 * triangle number; of more than 32767 in one texel the 32767 largest are kept, and their shares made to end at 1 (the
 * point's area stays that of all).
 *
 * An object that has triangles with two sides (KILN_RECORD_DOUBLE_SIDED) has a second lightmap with the points of their
 * backs.
 *
 * A point lies in the cell that holds the centroid of its covered part. With KILN_PARTITION_OBJECTS a tile is one
 * tile run whatever cells it lies in, and the tile run's `cell` is that of its first point.
 *
 * `albedo` is the area-weighted mean over the covered part: at the centroid of each piece, or where the base colour is
 * textured at 16 or more stratified positions; of a surface with an alpha mask or blending only what is there counts
 * (weight alpha). `visible` is all ones: the validity pass lowers it.
 *
 * Ranks share out whole cells (objects) where that keeps the largest share within 10 % of the mean, else tile runs;
 * ranks beyond the number of tile runs get an empty share.
 *
 * KILN_BAD_INPUT for a cell size that fits no grid, an object with 2^32 tiles or more; KILN_USAGE for ranks = 0 or rank
 * >= ranks; KILN_SYSTEM. Destroy with kiln_surface_destroy. */
int kiln_surface_build(struct kiln_surface **surface, const struct kiln_surface_params *params,
                       struct kiln_surface_report *report, struct kiln_error *error);

/* Cuts a row of units (cells, objects or tile runs in global order, with so many points each) into `ranks` contiguous
 * shares of nearly equal points: the border before share r is the unit border nearest to r / ranks of all points (of
 * two, the first). Share r is units cuts[r] .. cuts[r + 1] - 1; writes ranks + 1 cuts, ranks >= 1. Pure. */
void kiln_partition_cut(const uint64_t *unit_points, size_t unit_count, uint32_t ranks, uint64_t *cuts);

#endif
