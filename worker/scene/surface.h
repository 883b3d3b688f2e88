/* Surface points: the texels of all lightmaps that lie on geometry, and how to find them from a hit.
 *
 * Every object has a lightmap for its front. Where a triangle has two sides (KILN_RECORD_DOUBLE_SIDED), its object has
 * a second one for the backs, with the same layout; its texels are twice as wide unless it is published, for it is only
 * seen by rays. The points of a back have the same surface as those of the front, normals that point the other way, and
 * light of their own. Lightmaps are numbered: object o's front is lightmap o, its back lightmap object_count + o.
 *
 * Every lightmap is cut into tiles of 8 x 8 texels. In a tile, texel (x, y), 0 <= x, y < 8, has the bit
 * kiln_morton8(x, y). Surface points have a global index: by cell along a Morton curve, then by lightmap, then by tile
 * in Morton order, then by bit (with partition by objects: by lightmap, then by tile, then by bit). The points of one
 * tile that lie in one cell are a *tile run*: contiguous, at most 64, the smallest unit of work. A tile that lies in
 * several cells has several tile runs (with partition by objects a tile is one tile run, its `cell` that of its first
 * point). A rank owns a contiguous range of tile runs, so a contiguous range of points.
 *
 * Tiles, splits and radiosity are the same on all ranks; tile runs, pieces and per-point data are a rank's own share.
 */
#ifndef KILN_WORKER_SCENE_SURFACE_H
#define KILN_WORKER_SCENE_SURFACE_H

#include <stdbool.h>
#include <stdint.h>

#include "worker/scene/geometry.h"

#define KILN_TILE_SPLIT ((uint64_t)KILN_TILE_SPLIT_HIGH << 32)
#define KILN_NO_POINT UINT64_MAX

struct kiln_tile {
    uint64_t mask;  /* covered texels */
    uint64_t first; /* global index of its first point; or KILN_TILE_SPLIT | index of its first entry in `splits` */
};
/* A split tile's entries stand one after the other; together their masks are the tile's. */
struct kiln_tile_part {
    uint64_t mask;
    uint64_t first;
};

struct kiln_lightmap {
    uint64_t tile_first;
    uint32_t width, height;
    uint32_t tiles_x, tiles_y;
    uint32_t shift;     /* its texels are 2^shift as wide and high as those that the scene gives the object */
    uint32_t published; /* 1: it is written as a file */
};

/* The points of one tile in one cell. */
struct kiln_tile_run {
    uint64_t first; /* global index of its first point */
    uint64_t mask;
    uint32_t map;  /* lightmap */
    uint32_t tile; /* y * tiles_x + x within the lightmap */
    uint32_t cell; /* index among the occupied cells */
    uint32_t count;
};

/* A point's pieces: how many, and whether the one piece covers the texel's square wholly. */
#define KILN_PIECES_WHOLE ((uint16_t)0x8000)
enum { KILN_PIECES_MOST = 0x7fff };

struct kiln_surface {
    /* the same on all ranks */
    uint64_t point_count;
    uint64_t tile_count, split_count;
    struct kiln_tile *tiles;
    struct kiln_tile_part *splits;
    uint32_t object_count;
    uint32_t map_count;              /* object_count; or twice that, where some object has backs */
    struct kiln_lightmap *lightmaps; /* map_count; of an object without backs the second has no tiles */
    uint64_t cell_count;             /* occupied cells */
    /* cell_count + 1: global index of each cell's first point (cells partition only; else NULL) */
    uint64_t *cell_first;
    bool map_is_lent;   /* tiles, splits, lightmaps and cell_first are somebody else's to free */
    bool share_is_lent; /* the arrays of this rank's share are somebody else's to free */
    /* this rank's share */
    uint64_t first, count; /* global range of own points */
    size_t tile_run_count;
    struct kiln_tile_run *tile_runs;
    /* Which triangles cover a point: its *pieces*, world triangles. Points of a tile run stand in order, so a reader
     * walks a tile run from piece_base[f] (and area_cdf_base[f]) on, adding each point's kiln_piece_count; a point of n
     * pieces also has n - 1 shares: cumulative parts of its area. The last, exactly 1, is not stored. */
    uint64_t *piece_base;    /* tile_run_count + 1 */
    uint64_t *area_cdf_base; /* tile_run_count + 1 */
    /* own point: 1 to KILN_PIECES_MOST, and perhaps KILN_PIECES_WHOLE: read with the functions below */
    uint16_t *piece_count;
    uint32_t *pieces;
    float *area_cdf;
    uint16_t *albedo; /* own point: 3 values, 65535 = 1 */
    float *area;      /* own point: m2 of surface covered */
    /* own point: 65535 x the share of its area that is not buried in other geometry; 0: no light can be gathered here,
     * it is filled from valid neighbours at the end. 65535 until the validity pass */
    uint16_t *visible;
};

static inline uint32_t kiln_piece_count(const struct kiln_surface *s, uint64_t own)
{
    return s->piece_count[own] & KILN_PIECES_MOST;
}
static inline bool kiln_point_whole(const struct kiln_surface *s, uint64_t own)
{
    return (s->piece_count[own] & KILN_PIECES_WHOLE) != 0;
}

/* Light can be gathered here; others are filled from valid neighbours at the end. */
static inline bool kiln_point_valid(const struct kiln_surface *s, uint64_t own) { return s->visible[own] != 0; }

/* Column and row of a bit of kiln_morton8 (shaders/shared/surface.h). */
static inline uint32_t kiln_morton8_x(uint32_t bit) { return (bit & 1u) | (bit >> 1 & 2u) | (bit >> 2 & 4u); }
static inline uint32_t kiln_morton8_y(uint32_t bit) { return (bit >> 1 & 1u) | (bit >> 2 & 2u) | (bit >> 3 & 4u); }

/* The object that a lightmap is of, and whether it is the one of its backs. */
static inline uint32_t kiln_map_object(const struct kiln_surface *s, uint32_t map)
{
    return map < s->object_count ? map : map - s->object_count;
}
static inline bool kiln_map_back(const struct kiln_surface *s, uint32_t map) { return map >= s->object_count; }

/* Global index of the point at texel (x, y) of lightmap `number`, or KILN_NO_POINT. (x, y) must lie inside it. */
static inline uint64_t kiln_surface_find(const struct kiln_surface *s, uint32_t number, uint32_t x, uint32_t y)
{
    const struct kiln_lightmap *map = &s->lightmaps[number];
    const struct kiln_tile *tile = &s->tiles[map->tile_first + (uint64_t)(y / 8) * map->tiles_x + x / 8];
    const uint64_t bit = 1ull << kiln_morton8(x % 8, y % 8);
    if ((tile->mask & bit) == 0)
        return KILN_NO_POINT;
    if ((tile->first & KILN_TILE_SPLIT) == 0)
        return tile->first + (uint64_t)__builtin_popcountll(tile->mask & (bit - 1));
    const struct kiln_tile_part *part = s->splits + (tile->first & ~KILN_TILE_SPLIT);
    while ((part->mask & bit) == 0)
        part++;
    return part->first + (uint64_t)__builtin_popcountll(part->mask & (bit - 1));
}

void kiln_surface_destroy(struct kiln_surface **surface);

#endif
