/* The surface: all surface points (the texels of all lightmaps that lie on geometry), and the tables that map texels to
 * points. The lookup from a ray's hit to a point is in worker/store/store.h.
 *
 * Every object has a lightmap for its front. An object with double-sided triangles (KILN_RECORD_DOUBLE_SIDED) has a
 * second one for their backs, with the same layout. Unless it is published, it serves only ray hits, and its texels are
 * twice as wide. The points of a back lie on the same surface as those of the front, with reversed normals and light of
 * their own. Object o's front is lightmap o; its back is lightmap object_count + o.
 *
 * Every lightmap is cut into tiles of 8 x 8 texels. In a tile, texel (x, y), 0 <= x, y < 8, has the bit kiln_morton8(x,
 * y). Surface points have a global index: they are sorted by cell along a Morton curve, then by lightmap, then by tile
 * in Morton order, then by bit. (With partition by objects: by lightmap, then tile, then bit.) The points of one tile
 * that lie in one cell are a *tile run*: contiguous, at most 64, the smallest unit of work. A tile that lies in several
 * cells has several tile runs. (With partition by objects a tile is one tile run, and its `cell` is that of its first
 * point.) A rank owns a contiguous range of tile runs, so a contiguous range of points.
 *
 * Octrees. If the geometry has leaves (worker/scene/leaves.h), each "lightmap" here is an octree instead: the surface
 * of one object that faces one of six sides. Its tiles are the *bricks*, cubes of 4 x 4 x 4 leaves that contain some of
 * this surface, in Morton order: a brick is the lowest two levels of the octree, and in it leaf (x, y, layer) has the
 * bit kiln_morton4(x, y, layer). So a tile's mask has a bit for each occupied leaf, a surface point is an occupied
 * leaf, and everything else is as with lightmaps. For random numbers and messages, the leaves of brick b are numbered
 * like the texels of tile b in a lightmap with one row of tiles. The octree of object o's front and side s is lightmap
 * s * object_count + o; the octrees of backs follow all fronts, in the same order. A hash table maps a brick's place to
 * its tile.
 *
 * Tiles and splits are the same on all ranks; tile runs, pieces and per-point data exist for the rank's own points
 * only. */
#ifndef KILN_WORKER_SCENE_SURFACE_H
#define KILN_WORKER_SCENE_SURFACE_H

#include <assert.h>
#include <stdbool.h>
#include <stdint.h>

#include "shaders/shared/divided.h"
#include "shaders/shared/store_octree.h"
#include "worker/scene/geometry.h"

#define KILN_TILE_SPLIT ((uint64_t)KILN_TILE_SPLIT_HIGH << 32)
#define KILN_NO_POINT UINT64_MAX

/* Numbers of a surface point, as two types that a compiler keeps apart. `kiln_own_of_global` and `kiln_global_of_own`
 * convert. The radiosity of all points is indexed by global numbers, a rank's arrays by own numbers. */
struct kiln_global_point {
    uint64_t at; /* in the global order of all ranks' points */
};
struct kiln_own_point {
    uint64_t at; /* among the points of the rank that owns it */
};

struct kiln_tile {
    uint64_t mask; /* texels with a surface point, one bit each */
    /* global index of its first point; for a tile with several tile runs KILN_TILE_SPLIT | index of its first entry in
     * `splits` */
    uint64_t first;
};
/* One tile run of a split tile. A tile's entries are consecutive; together their masks are the tile's mask. They are
 * preceded by entries of single texels divided by walls: `first` is KILN_TILE_SPLIT | index in `divided`. */
struct kiln_split_tile_run {
    uint64_t mask;
    struct kiln_global_point first;
};

/* A texel divided by walls into parts that no light passes between. Each part that light can reach is a surface point
 * of its own, so that no light leaks through a wall. Part 0 is shown in the lightmap and has the texel's point there.
 * Parts 1, 2 and 3 have their points at the same texel of additional lightmaps, which are not written to files
 * (kiln_map_part).
 *
 * Lines cut the texel into convex cells, and each cell belongs to a part or to none (shaders/shared/divided.h). A place
 * within `margin` of a line between two parts belongs to none, since rounding decides on which side of the wall a ray
 * hits. Samples of a part come from a convex set of its cells, at least `margin` away from its lines. */
struct kiln_divided_texel {
    struct kiln_global_point part[KILN_SUBTEXELS]; /* point of each part; KILN_NO_POINT: no such part */
    float lines[KILN_CUT_FLOATS];
    float margin; /* in sides of the texel */
    uint32_t line_count;
    uint32_t codes[2];
    uint32_t sides; /* byte k for part k: bits 0-3 the lines that bound its samples; bits 4-7 the code of the sides */
    uint32_t bit;   /* of the texel in the tile */
    uint64_t tile;  /* index in `tiles`, of the lightmap of subtexel 0 */
    float within;   /* m2 of part 0's area in cells without a part, which get no light */
    /* bits 0-7: mask of neighbours (kiln_neighbour_texel) that see much less of the surface than part 0
     * (bake/points/divided.h); bits 8-19 and 20-31: x and y of a place in part 0, 0 to 4095 over the texel */
    uint32_t shown;
};
static inline float kiln_divided_shown_x(const struct kiln_divided_texel *t)
{
    return (float)(t->shown >> 8 & 0xfffu) / 4095.0f;
}
static inline float kiln_divided_shown_y(const struct kiln_divided_texel *t)
{
    return (float)(t->shown >> 20) / 4095.0f;
}
/* Part of the cell that contains the place (x, y), which may lie outside the texel; KILN_SUBTEXEL_NONE: none. The
 * margin is ignored. */
static inline uint32_t kiln_divided_subtexel(const struct kiln_divided_texel *texel, float x, float y)
{
    uint32_t code = 0;
    for (uint32_t i = 0; i < texel->line_count; i++)
        code |= (uint32_t)(texel->lines[3 * i] * x + texel->lines[3 * i + 1] * y > texel->lines[3 * i + 2]) << i;
    return kiln_cut_subtexel(texel->codes[0], texel->codes[1], code);
}
/* Point at the place (x, y) of the texel; KILN_NO_POINT within the margin and in cells without a part. */
static inline struct kiln_global_point kiln_divided_choose(const struct kiln_divided_texel *texel, float x, float y)
{
    uint32_t sure = 0, perhaps = 0;
    for (uint32_t i = 0; i < texel->line_count; i++)
        kiln_cut_add(texel->lines[3 * i] * x + texel->lines[3 * i + 1] * y - texel->lines[3 * i + 2], texel->margin, i,
                     &sure, &perhaps);
    const uint32_t part = kiln_cut_subtexel(texel->codes[0], texel->codes[1], sure);
    return part < KILN_SUBTEXELS && part == kiln_cut_subtexel(texel->codes[0], texel->codes[1], perhaps)
               ? texel->part[part]
               : (struct kiln_global_point){KILN_NO_POINT};
}

/* The k-th of the eight neighbours of a texel, in steps from it. */
enum { KILN_NEIGHBOUR_TEXELS = 8 };
static inline void kiln_neighbour_texel(uint32_t k, int step[2])
{
    const uint32_t place = k < 4 ? k : k + 1; /* of a square of 3 x 3, without its middle */
    step[0] = (int)(place % 3) - 1;
    step[1] = (int)(place / 3) - 1;
}

/* Table entry to find a part of a divided texel by its point. */
struct kiln_subtexel {
    struct kiln_global_point point;
    uint64_t divided; /* index in `divided` */
    uint32_t part, reserved;
};

struct kiln_lightmap {
    uint64_t tile_first;
    uint32_t width, height;
    uint32_t tiles_x, tiles_y;
    uint32_t shift;     /* texels are 2^shift times as wide and high as those of the object's size in the scene */
    uint32_t published; /* 1: it is written to a file */
};

/* A slot of the hash table of bricks. */
struct kiln_brick_slot {
    uint64_t place; /* kiln_brick_place */
    uint32_t map;
    uint32_t tile; /* 1 + index in `tiles`; 0: the slot is empty */
};

/* A tile run: the points of one tile in one cell. */
struct kiln_tile_run {
    struct kiln_global_point first;
    uint64_t mask;
    uint32_t map;  /* lightmap */
    uint32_t tile; /* y * tiles_x + x within the lightmap */
    uint32_t cell; /* index among the occupied cells */
    uint32_t count;
};

/* An entry of `piece_count`: the number of pieces, and a flag that the one piece covers the whole square of the
 * texel. */
#define KILN_PIECES_WHOLE ((uint16_t)0x8000)
enum { KILN_PIECES_MOST = 0x7fff };

struct kiln_surface {
    /* global arrays: the same on all ranks */
    uint64_t point_count;
    uint64_t tile_count, split_count;
    struct kiln_tile *tiles;
    struct kiln_split_tile_run *splits;
    uint64_t divided_count;
    struct kiln_divided_texel *divided; /* by point of subtexel 0 */
    uint64_t part_count;
    struct kiln_subtexel *parts; /* of all divided texels, by point */
    /* octrees: the place of each tile's brick (kiln_brick_place), and the hash table; NULL with lightmaps */
    uint64_t *bricks;
    struct kiln_brick_slot *slots;
    uint64_t slot_count; /* a power of two */
    uint32_t object_count;
    /* number of lightmaps without those of parts 1 and above: object_count, times the sides for octrees; twice that if
     * any object has backs */
    uint32_t whole_maps;
    uint32_t map_count;              /* whole_maps, times the largest number of subtexels of a texel */
    struct kiln_lightmap *lightmaps; /* a lightmap of backs has no tiles if the object has no backs */
    uint64_t cell_count;             /* cells that hold points */
    /* one per cell, and one more at the end: global index of its first point. NULL without partition by cells */
    uint64_t *cell_first;
    bool global_is_borrowed; /* the global arrays are borrowed: kiln_surface_destroy leaves them alone */
    bool own_is_borrowed;    /* this rank's arrays are borrowed: kiln_surface_destroy leaves them alone */
    /* this rank's arrays */
    struct kiln_global_point first; /* its first point, and the number of its points */
    uint64_t count;
    size_t tile_run_count;
    struct kiln_tile_run *tile_runs;
    /* The triangles that cover a point are its *pieces*, world triangle numbers. The points of a tile run are stored in
     * order: start at piece_base[run] and area_cdf_base[run] and add each point's kiln_piece_count (kiln_point_next
     * does this). A point of n pieces also has n - 1 entries of area_cdf: the cumulative fractions of its area. The
     * last fraction, exactly 1, is not stored. */
    uint64_t *piece_base, *area_cdf_base; /* one per tile run, and one more at the end */
    /* per point: 1 to KILN_PIECES_MOST, and perhaps KILN_PIECES_WHOLE. Read it with the functions below */
    uint16_t *piece_count;
    uint32_t *pieces;
    float *area_cdf;
    uint16_t *albedo; /* per point: 3 values, 65535 = 1 */
    float *area;      /* per point: m2 of surface covered */
    /* per point: 65535 x the fraction of its area that is not buried in other geometry or within a wall. Until the
     * validity pass it is 65535. A point with 0 gathers no light and is filled from valid neighbours at the end */
    uint16_t *visible;
    /* per point: radiance probes near it (KILN_PROBE_SEEN in shaders/shared/radiance_probe.h). NULL: no radiance probes
     */
    uint32_t *near_probes;
    /* KILN_GUIDE_FLOATS a point: guides of tile runs (worker/pass/guided.h). NULL: none */
    float *guide;
    /* KILN_CLOSING_FLOATS a point: numbers that close its row (worker/pass/patches.h). NULL: none kept */
    float *closing;
};

/* Converts a point's number. The point must be this rank's, or of the rank whose arrays the surface views. */
static inline struct kiln_own_point kiln_own_of_global(const struct kiln_surface *s, struct kiln_global_point point)
{
    assert(point.at - s->first.at < s->count);
    return (struct kiln_own_point){point.at - s->first.at};
}
static inline struct kiln_global_point kiln_global_of_own(const struct kiln_surface *s, struct kiln_own_point own)
{
    return (struct kiln_global_point){s->first.at + own.at};
}

static inline uint32_t kiln_piece_count(const struct kiln_surface *s, struct kiln_own_point own)
{
    return s->piece_count[own.at] & KILN_PIECES_MOST;
}
static inline bool kiln_point_whole(const struct kiln_surface *s, struct kiln_own_point own)
{
    return (s->piece_count[own.at] & KILN_PIECES_WHOLE) != 0;
}

/* Whether light can be gathered at the point. Other points are filled from valid neighbours at the end. */
static inline bool kiln_point_valid(const struct kiln_surface *s, struct kiln_own_point own)
{
    return s->visible[own.at] != 0;
}

/* Area of the point that can be lit, m2: not buried and not cut out by its material. `present`: mean of
 * kiln_surface_opacity, from a pass (worker/pass/point.h). */
static inline double kiln_lit_area(const struct kiln_surface *s, struct kiln_own_point own, float present)
{
    return (double)s->area[own.at] * ((double)s->visible[own.at] / 65535.0) * (double)present;
}

/* Number of points in consecutive tile runs, from `first` to `last`. */
static inline uint64_t kiln_tile_runs_points(const struct kiln_tile_run *first, const struct kiln_tile_run *last)
{
    return last->first.at + last->count - first->first.at;
}

/* Column and row of a bit of kiln_morton8 (shaders/shared/surface.h). */
static inline uint32_t kiln_morton8_x(uint32_t bit) { return (bit & 1u) | (bit >> 1 & 2u) | (bit >> 2 & 4u); }
static inline uint32_t kiln_morton8_y(uint32_t bit) { return (bit >> 1 & 1u) | (bit >> 2 & 2u) | (bit >> 3 & 4u); }

/* The object of a lightmap, and whether the lightmap is that of its backs. */
static inline uint32_t kiln_map_object(const struct kiln_surface *s, uint32_t map)
{
    return map < s->object_count ? map : map % s->object_count;
}
/* Number of lightmaps or octrees of the fronts. */
static inline uint32_t kiln_front_maps(const struct kiln_surface *s)
{
    return s->bricks != NULL ? KILN_SIDES * s->object_count : s->object_count;
}
static inline bool kiln_map_back(const struct kiln_surface *s, uint32_t map)
{
    return map % s->whole_maps >= kiln_front_maps(s);
}
/* Whether the light of a lightmap's points is part of the result: fronts, and published backs. Other backs, such as
 * insides of solids with double-sided triangles, serve only ray hits. */
static inline bool kiln_map_is_result(const struct kiln_surface *s, uint32_t map)
{
    return !kiln_map_back(s, map) || s->lightmaps[map % s->whole_maps].published != 0;
}
/* Part of divided texels that a lightmap's points belong to; 0: also whole texels. Part k of lightmap `map` is lightmap
 * map + k whole_maps. */
static inline uint32_t kiln_map_part(const struct kiln_surface *s, uint32_t map) { return map / s->whole_maps; }

/* Packs the grid coordinates of a brick into one word, and unpacks them. */
static inline uint64_t kiln_brick_place(uint32_t x, uint32_t y, uint32_t layer)
{
    return (uint64_t)kiln_brick_high(y, layer) << 32 | kiln_brick_low(x, y);
}
static inline uint32_t kiln_brick_x(uint64_t place) { return (uint32_t)place & 0x7ffffu; }
static inline uint32_t kiln_brick_y(uint64_t place) { return (uint32_t)(place >> 19) & 0x7ffffu; }
static inline uint32_t kiln_brick_layer(uint64_t place) { return (uint32_t)(place >> 38) & 0x7ffffu; }

/* Column, row and layer in its brick of a leaf's bit (kiln_morton4). */
static inline uint32_t kiln_morton4_x(uint32_t bit) { return (bit & 1u) | (bit >> 2 & 2u); }
static inline uint32_t kiln_morton4_y(uint32_t bit) { return (bit >> 1 & 1u) | (bit >> 3 & 2u); }
static inline uint32_t kiln_morton4_layer(uint32_t bit) { return (bit >> 2 & 1u) | (bit >> 4 & 2u); }

/* Finds the slot of an octree's brick, or the empty slot where it would be inserted. */
static inline const struct kiln_brick_slot *kiln_brick_slot(const struct kiln_surface *s, uint32_t map, uint64_t place)
{
    const uint64_t last = s->slot_count - 1;
    uint64_t i = kiln_brick_hash((uint32_t)place, (uint32_t)(place >> 32), map) & last;
    while (s->slots[i].tile != 0 && (s->slots[i].place != place || s->slots[i].map != map))
        i = (i + 1) & last;
    return &s->slots[i];
}

/* Finds the divided texel and part of a point; NULL: its texel is not divided. */
const struct kiln_subtexel *kiln_surface_subtexel(const struct kiln_surface *s, struct kiln_global_point point);

/* Subtracts the unlit area of divided texels from `visible` of this rank's points. Call once, after the validity pass.
 * Valid points stay valid. */
void kiln_surface_leave_walls_out(struct kiln_surface *s);

/* Entry of a tile at the bit of a texel: a point, KILN_TILE_SPLIT | index in `divided`, or KILN_NO_POINT. */
static inline struct kiln_global_point kiln_tile_entry(const struct kiln_surface *s, const struct kiln_tile *tile,
                                                       uint32_t number)
{
    const uint64_t bit = 1ull << number;
    if ((tile->mask & bit) == 0)
        return (struct kiln_global_point){KILN_NO_POINT};
    if ((tile->first & KILN_TILE_SPLIT) == 0)
        return (struct kiln_global_point){tile->first + (uint64_t)__builtin_popcountll(tile->mask & (bit - 1))};
    const struct kiln_split_tile_run *run = s->splits + (tile->first & ~KILN_TILE_SPLIT);
    while ((run->mask & bit) == 0)
        run++;
    return (struct kiln_global_point){run->first.at + (uint64_t)__builtin_popcountll(run->mask & (bit - 1))};
}

/* Point of a tile at the bit of a texel; for a divided texel the point of part 0. KILN_NO_POINT: none. */
static inline struct kiln_global_point kiln_tile_point(const struct kiln_surface *s, const struct kiln_tile *tile,
                                                       uint32_t number)
{
    const struct kiln_global_point entry = kiln_tile_entry(s, tile, number);
    return (entry.at & KILN_TILE_SPLIT) != 0 && entry.at != KILN_NO_POINT
               ? s->divided[entry.at & ~KILN_TILE_SPLIT].part[0]
               : entry;
}

/* Entry at texel (x, y) of lightmap `number`: a point, KILN_TILE_SPLIT | index in `divided`, or KILN_NO_POINT. (x, y)
 * must lie inside the lightmap. */
static inline struct kiln_global_point kiln_surface_entry(const struct kiln_surface *s, uint32_t number, uint32_t x,
                                                          uint32_t y)
{
    const struct kiln_lightmap *map = &s->lightmaps[number];
    return kiln_tile_entry(s, &s->tiles[map->tile_first + kiln_tile_of(x, y, map->tiles_x)],
                           kiln_morton8(x % 8, y % 8));
}

/* The point at texel (x, y) of lightmap `number`; its `at` is KILN_NO_POINT if there is none. (x, y) must lie inside
 * the lightmap. */
static inline struct kiln_global_point kiln_surface_find(const struct kiln_surface *s, uint32_t number, uint32_t x,
                                                         uint32_t y)
{
    const struct kiln_global_point entry = kiln_surface_entry(s, number, x, y);
    if ((entry.at & KILN_TILE_SPLIT) == 0 || entry.at == KILN_NO_POINT)
        return entry;
    return s->divided[entry.at & ~KILN_TILE_SPLIT].part[0];
}

/* The point in the leaf (x, y, layer) of octree `number`; its `at` is KILN_NO_POINT if there is none. */
struct kiln_global_point kiln_surface_find_leaf(const struct kiln_surface *s, uint32_t number, uint32_t x, uint32_t y,
                                                uint32_t layer);

void kiln_surface_destroy(struct kiln_surface **surface);

#endif
