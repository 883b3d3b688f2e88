/* Builds the surface from the lightmap layouts: the surface points, their cells, and the partition between the ranks.
 */
#ifndef KILN_COORDINATOR_SURFACE_SURFACE_BUILD_H
#define KILN_COORDINATOR_SURFACE_SURFACE_BUILD_H

#include <stdbool.h>
#include <stdint.h>

#include "worker/base/stop.h"
#include "worker/scene/surface.h"

enum kiln_partition { KILN_PARTITION_CELLS = 0, KILN_PARTITION_OBJECTS = 1 };

/* Receives `count` records of one kind. The records are valid during the call only. */
typedef void (*kiln_surface_taker)(void *taker, const void *records, size_t count);

/* The communication between the ranks that build a surface together: four collective operations. coordinator/bake
 * implements them over MPI; tests and single processes need no MPI.
 *
 * Every function is called by all ranks with the same record size and kind. Each rank passes its own `status` so far.
 * If any of them is not KILN_OK, or if a rank fails during the operation, nothing is delivered and all ranks return the
 * worst status with its sentence in `error`. */
struct kiln_surface_exchange {
    void *context;
    int (*agree)(void *context, int status, struct kiln_error *error);
    /* Allreduce and Exscan: values[i] becomes the sum over all ranks, before[i] the sum over the ranks before this one.
     * `before` may be NULL. */
    int (*sum)(void *context, int status, uint64_t *values, uint64_t *before, size_t count, struct kiln_error *error);
    /* Allgather: hands the records of all ranks, this one's among them, to `take` on every rank, in several calls and
     * in any order of ranks. */
    int (*allgather)(void *context, int status, const void *own, size_t count, size_t size, kiln_surface_taker take,
                     void *taker, struct kiln_error *error);
    /* Alltoall: hands each rank the records meant for it. The first counts[0] records of `own` are for rank 0, the next
     * counts[1] for rank 1; counts[own rank] is 0. */
    int (*alltoall)(void *context, int status, const void *own, const size_t *counts, size_t size,
                    kiln_surface_taker take, void *taker, struct kiln_error *error);
};

struct kiln_surface_params {
    const struct kiln_scene *scene;       /* borrowed during the call */
    const struct kiln_geometry *geometry; /* borrowed during the call */
    /* m. 0: chosen from the scene alone, never from the number of ranks: a 24th of the longest side, doubled until an
     * occupied cell holds 1024 points on average */
    double cell_size;
    enum kiln_partition partition;
    bool whole_tiles; /* tiles are not split between cells: all points of a tile lie in the cell of its first point */
    /* lightmaps of the backs of all objects are published, at the resolution of the fronts */
    bool both_sides;
    uint32_t rank, ranks; /* the rank whose points are wanted, and the number of ranks the surface is divided between */
    /* NULL: this process builds the surface alone; else all `ranks` call together and divide the work */
    const struct kiln_surface_exchange *exchange;
    uint32_t threads;             /* 0: all */
    const struct kiln_stop *stop; /* borrowed; NULL: none. When asked, all ranks return KILN_STOPPED */
};

/* Counts and areas of the whole surface: the same on all ranks. */
struct kiln_surface_report {
    uint64_t points, texels; /* of fronts and backs */
    uint64_t back_points;
    uint64_t cells_occupied, cells_total;
    double cell_size;  /* m */
    uint64_t cells[3]; /* grid */
    uint64_t tile_runs;
    double area;                    /* m2, sum over all points of fronts */
    double geometry_area;           /* m2, sum over all triangles */
    double worst_object_area_error; /* largest |sum of texel areas / surface area - 1| over objects with area */
    uint32_t worst_object;
    uint64_t overlapped_texels;      /* texels that hold pieces of more than one chart */
    double imbalance;                /* points of the rank with the most / mean over the ranks - 1 */
    uint64_t points_min, points_max; /* of the rank with the fewest and of the one with the most */
};

/* Builds the surface. Its global arrays are the same on all ranks; the other arrays hold rank `rank`'s points only.
 *
 * With an exchange, the call is collective over the ranks and returns the same status on all. Each rank covers some
 * blocks of lightmap tiles, chosen for equal estimated work whichever points the rank will own in the end. The ranks
 * add up how many points lie in each cell, so that each can number the points it has found. Then every rank learns
 * where the points of each tile begin, and the owner of each tile run receives it. Of the other ranks' surface, a rank
 * holds only the map of tiles. Without an exchange, one process covers the whole scene, whatever `ranks` is. Both give
 * the same bits.
 *
 * Coverage is conservative: a texel that a triangle touches with non-zero area is a point even if its centre lies on no
 * triangle. Each triangle is clipped to each texel it touches (worker/scene/clip.h), so areas are exact. Triangles
 * without area in the world have no points. A triangle without area in the lightmap alone belongs wholly to the texel
 * of its centroid there. A texel that triangles of several charts touch keeps all their pieces. Pieces are in order of
 * world triangle number. Of more than 32767 pieces in one texel the 32767 largest are kept, and their area CDF is
 * scaled to end at 1; the point's area stays that of all pieces.
 *
 * An object that has double-sided triangles (KILN_RECORD_DOUBLE_SIDED) has a second lightmap with the points of their
 * backs.
 *
 * A point lies in the cell that holds the centroid of its covered part. With KILN_PARTITION_OBJECTS a tile is one tile
 * run whatever cells it lies in, and the tile run's `cell` is that of its first point.
 *
 * `albedo` is the area-weighted mean over the covered part. It is evaluated at the centroid of each piece. If the base
 * colour is textured, it is the texture's mean over the piece (worker/scene/texture_means.h), including a metal texture
 * that is read at the same places. If no such mean exists (a metal texture of another size or placement, a
 * transmission texture, a mask under uneven vertex alpha), up to 256 random samples in the texel are averaged. If the
 * surface has an alpha mask or is blended, each sample is also weighted with its opacity. `visible` is set to 65535
 * everywhere; the validity pass lowers it later.
 *
 * Ranks get whole cells (with KILN_PARTITION_OBJECTS whole lightmaps) if no rank then has more than 1.1 times the mean
 * number of points; otherwise the border between two ranks may lie between any two tile runs. Ranks beyond the number
 * of tile runs have no points.
 *
 * KILN_BAD_INPUT for a cell size that fits no grid or an object with 2^32 tiles or more; KILN_USAGE for ranks = 0 or
 * rank >= ranks; KILN_SYSTEM. Destroy with kiln_surface_destroy. */
int kiln_surface_build(struct kiln_surface **surface, const struct kiln_surface_params *params,
                       struct kiln_surface_report *report, struct kiln_error *error);

/* Largest imbalance with which ranks get whole cells (or objects): points of the largest rank / mean - 1. Above it the
 * partition splits between tile runs. */
#define KILN_PARTITION_IMBALANCE 0.1

/* Splits a row of units (cells, objects or tile runs in global order, with unit_points[i] points each) into `ranks`
 * contiguous ranges with nearly equal numbers of points: the border before range r is the unit border nearest to r /
 * ranks of all points (of two equally near, the first). Range r is units bounds[r] .. bounds[r + 1] - 1. Writes ranks +
 * 1 bounds; ranks >= 1. Pure. */
void kiln_partition_cut(const uint64_t *unit_points, size_t unit_count, uint32_t ranks, uint64_t *bounds);

#endif
