/* The lightmap as a store (store.h, which includes this): light is stored in the texels of the final lightmaps. Lookup
 * of a hit: barycentrics -> texel -> tile -> surface point. It reads the tables of the surface (worker/scene/surface.h)
 * and has none of its own. */
#ifndef KILN_WORKER_STORE_LIGHTMAP_H
#define KILN_WORKER_STORE_LIGHTMAP_H

#include <math.h>

#include "shaders/shared/store_lightmap.h"
#include "worker/scene/geometry.h"
#include "worker/scene/surface.h"

/* Both borrowed. */
struct kiln_store {
    const struct kiln_surface *surface;
    const struct kiln_geometry *geometry;
};

enum { KILN_STORE_WAYS = 64, KILN_STORE_ARRAYS = 6 };

struct kiln_store_ways {
    const struct kiln_tile *tile[KILN_STORE_WAYS];
    const struct kiln_split_tile_run *split_parts[KILN_STORE_WAYS]; /* of hits on split tiles */
    uint8_t bit[KILN_STORE_WAYS];                                   /* of the texel in its tile */
    uint8_t open[KILN_STORE_WAYS]; /* hits on split tiles; later hits on divided texels */
};

/* ---- from a hit to a texel ---- */

/* Lightmap coordinates, in texels, of hit (u, v); and column and row of its texel, in a lightmap of this width or
 * height. */
static inline float kiln_hit_x(const struct kiln_hit_record *r, float u, float v)
{
    return kiln_texel_coordinate(r->texel[0], r->texel[2], r->texel[4], u, v);
}
static inline float kiln_hit_y(const struct kiln_hit_record *r, float u, float v)
{
    return kiln_texel_coordinate(r->texel[1], r->texel[3], r->texel[5], u, v);
}
static inline int32_t kiln_hit_column(const struct kiln_hit_record *r, float u, float v, uint32_t width)
{
    return kiln_texel_of(kiln_hit_x(r, u, v), (int32_t)width - 1);
}
static inline int32_t kiln_hit_row(const struct kiln_hit_record *r, float u, float v, uint32_t height)
{
    return kiln_texel_of(kiln_hit_y(r, u, v), (int32_t)height - 1);
}

/* ---- one hit ---- */

/* Chooses the part of a divided texel that the hit is on; KILN_NO_POINT: none. */
static inline struct kiln_global_point kiln_store_settle(const struct kiln_store *store, uint32_t triangle, float u,
                                                         float v, bool back, struct kiln_global_point place)
{
    const struct kiln_surface *s = store->surface;
    const struct kiln_hit_record *record = &store->geometry->records[triangle];
    if ((place.at & KILN_TILE_SPLIT) == 0 || place.at == KILN_NO_POINT)
        return place;
    const uint32_t shift = s->lightmaps[record->object + (back ? s->object_count : 0u)].shift;
    const float scale = 1.0f / (float)(1u << shift), x = kiln_hit_x(record, u, v) * scale,
                y = kiln_hit_y(record, u, v) * scale;
    return kiln_divided_choose(&s->divided[place.at & ~KILN_TILE_SPLIT], x - floorf(x), y - floorf(y));
}

static inline struct kiln_global_point kiln_store_find(const struct kiln_store *store, uint32_t triangle, float u,
                                                       float v, bool back)
{
    const struct kiln_surface *s = store->surface;
    const struct kiln_hit_record *record = &store->geometry->records[triangle];
    const struct kiln_lightmap *front = &s->lightmaps[record->object];
    const uint32_t number = record->object + (back ? s->object_count : 0u), shift = s->lightmaps[number].shift;
    const uint32_t x = (uint32_t)kiln_hit_column(record, u, v, front->width),
                   y = (uint32_t)kiln_hit_row(record, u, v, front->height);
    return kiln_store_settle(store, triangle, u, v, back, kiln_surface_entry(s, number, x >> shift, y >> shift));
}

/* ---- many hits ---- */

/* Bit of a texel in its tile: kiln_morton8 of the low three bits of x and y, by y * 8 + x. */
static const uint8_t kiln_store_morton[KILN_TILE_TEXELS] = {
    0,  1,  4,  5,  16, 17, 20, 21, 2,  3,  6,  7,  18, 19, 22, 23, 8,  9,  12, 13, 24, 25,
    28, 29, 10, 11, 14, 15, 26, 27, 30, 31, 32, 33, 36, 37, 48, 49, 52, 53, 34, 35, 38, 39,
    50, 51, 54, 55, 40, 41, 44, 45, 56, 57, 60, 61, 42, 43, 46, 47, 58, 59, 62, 63,
};

/* First round: from a hit to its tile, which is prefetched. */
static inline void kiln_store_enter(const struct kiln_store *store, struct kiln_store_ways *ways, uint32_t i,
                                    uint32_t triangle, float u, float v, bool back)
{
    const struct kiln_hit_record *record = &store->geometry->records[triangle];
    const struct kiln_lightmap *lightmaps = store->surface->lightmaps, *map = &lightmaps[record->object];
    int32_t x = kiln_hit_column(record, u, v, map->width), y = kiln_hit_row(record, u, v, map->height);
    if (back) {
        map = &lightmaps[store->surface->object_count + record->object];
        x >>= map->shift;
        y >>= map->shift;
    }
    const struct kiln_tile *tile =
        &store->surface->tiles[map->tile_first + kiln_tile_of((uint32_t)x, (uint32_t)y, map->tiles_x)];
    __builtin_prefetch(tile);
    ways->tile[i] = tile;
    ways->bit[i] = kiln_store_morton[((uint32_t)y & 7u) << 3 | ((uint32_t)x & 7u)];
}

/* Second round: from tiles to points, or for split tiles (in several cells) to their entries. The loop has no branch on
 * this case, which would be unpredictable in scenes with many cells. Returns the number of hits on split tiles. */
static inline uint32_t kiln_store_follow_tiles(const struct kiln_store *store, struct kiln_store_ways *ways,
                                               uint32_t count, const uint64_t *radiosity, uint64_t *places)
{
    const struct kiln_split_tile_run *splits = store->surface->splits;
    uint32_t split_count = 0;
    for (uint32_t i = 0; i < count; i++) {
        const struct kiln_tile *tile = ways->tile[i];
        const uint64_t mask = tile->mask, first = tile->first, bit = 1ull << ways->bit[i],
                       place = first + (uint64_t)__builtin_popcountll(mask & (bit - 1));
        const bool is_there = (mask & bit) != 0, is_split = (first & KILN_TILE_SPLIT) != 0;
        const uintptr_t part = (uintptr_t)splits + (first & ~KILN_TILE_SPLIT) * sizeof *splits,
                        value = (uintptr_t)radiosity + place * sizeof *radiosity;
        places[i] = is_there ? place : KILN_NO_POINT;
        __builtin_prefetch((const void *)(is_split ? part : value));
        ways->split_parts[split_count] = (const struct kiln_split_tile_run *)part;
        ways->open[split_count] = (uint8_t)i;
        split_count += is_split & is_there;
    }
    return split_count;
}

/* Second and third round. Returns the number of open hits: those on divided texels, whose place is KILN_TILE_SPLIT |
 * index in `divided`. */
static inline uint32_t kiln_store_follow(const struct kiln_store *store, struct kiln_store_ways *ways, uint32_t count,
                                         const uint64_t *radiosity, uint64_t *places)
{
    const uint32_t split_count = kiln_store_follow_tiles(store, ways, count, radiosity, places);
    uint32_t open = 0;
    for (uint32_t k = 0; k < split_count; k++) {
        const uint8_t i = ways->open[k];
        const uint64_t bit = 1ull << ways->bit[i];
        const struct kiln_split_tile_run *part = ways->split_parts[k];
        part += (part->mask & bit) == 0; /* most such tiles have two parts */
        while ((part->mask & bit) == 0)
            part++;
        places[i] = part->first.at + (uint64_t)__builtin_popcountll(part->mask & (bit - 1));
        if ((part->first.at & KILN_TILE_SPLIT) != 0)
            ways->open[open++] = i;
        else
            __builtin_prefetch(&radiosity[places[i]]);
    }
    return open;
}

#endif
