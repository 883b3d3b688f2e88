#include "worker/backend/embree/lookup.h"

/* Bit of a texel in its tile: kiln_morton8 of the low three bits of x and y, by y * 8 + x. */
static const uint8_t morton_of[KILN_TILE_TEXELS] = {
    0,  1,  4,  5,  16, 17, 20, 21, 2,  3,  6,  7,  18, 19, 22, 23, 8,  9,  12, 13, 24, 25,
    28, 29, 10, 11, 14, 15, 26, 27, 30, 31, 32, 33, 36, 37, 48, 49, 52, 53, 34, 35, 38, 39,
    50, 51, 54, 55, 40, 41, 44, 45, 56, 57, 60, 61, 42, 43, 46, 47, 58, 59, 62, 63,
};

/* First the tile of each hit; what missed or met a back face drops out. */
KILN_CLONES static void find_tiles(const struct embree_backend *b, const struct tile_run_rays *rays, uint32_t lanes,
                                   struct rays_found *restrict f)
{
    const struct kiln_hit_record *records = b->params.geometry->records;
    const struct kiln_lightmap *lightmaps = b->surface->lightmaps;
    const struct kiln_tile *tiles = b->surface->tiles;
    uint32_t count = 0, escaped = 0, blocked = 0;
    for (uint32_t l = 0; l < lanes; l++) {
        const struct RTCRayHit8 *r = &rays->packets[l / PACKET];
        const uint32_t i = l % PACKET;
        const unsigned geometry = r->hit.geomID[i];
        if (geometry == RTC_INVALID_GEOMETRY_ID) {
            f->escaped_lane[escaped++] = (uint8_t)l;
            continue;
        }
        const struct kiln_hit_record *record = &records[embree_triangle(b, geometry, r->hit.primID[i])];
        const float facing = r->hit.Ng_x[i] * rays->direction[0][l] + r->hit.Ng_y[i] * rays->direction[1][l] +
                             r->hit.Ng_z[i] * rays->direction[2][l];
        if (facing > 0.0f && (record->material & KILN_RECORD_DOUBLE_SIDED) == 0) {
            f->blocked_lane[blocked++] = (uint8_t)l;
            continue;
        }
        const struct kiln_lightmap *map = &lightmaps[record->object];
        const float u = r->hit.u[i], v = r->hit.v[i];
        int32_t x = kiln_hit_column(record, u, v, map->width), y = kiln_hit_row(record, u, v, map->height);
        if (facing > 0.0f) {
            map = &lightmaps[b->surface->object_count + record->object];
            x >>= map->shift;
            y >>= map->shift;
        }
        const struct kiln_tile *tile = &tiles[map->tile_first + kiln_tile_of((uint32_t)x, (uint32_t)y, map->tiles_x)];
        __builtin_prefetch(tile);
        f->tile[count] = tile;
        f->bit[count] = morton_of[((uint32_t)y & 7u) << 3 | ((uint32_t)x & 7u)];
        f->lane[count++] = (uint8_t)l;
    }
    f->count = count;
    f->escaped = escaped;
    f->blocked = blocked;
}

/* The point that an entry of a divided texel stands for where lane l met it. */
static uint64_t of_divided(const struct embree_backend *b, const struct tile_run_rays *rays, uint32_t l,
                           struct kiln_global_point entry)
{
    const struct RTCRayHit8 *r = &rays->packets[l / PACKET];
    const uint32_t i = l % PACKET;
    const struct kiln_hit_record *record =
        &b->params.geometry->records[embree_triangle(b, r->hit.geomID[i], r->hit.primID[i])];
    const bool back = r->hit.Ng_x[i] * rays->direction[0][l] + r->hit.Ng_y[i] * rays->direction[1][l] +
                          r->hit.Ng_z[i] * rays->direction[2][l] >
                      0.0f;
    const uint32_t number = record->object + (back ? b->surface->object_count : 0u);
    return embree_of_divided(b, record, r->hit.u[i], r->hit.v[i], b->surface->lightmaps[number].shift, entry).at;
}

/* Then the point in its tile; a tile that lies in several cells has parts, which are looked at in the end. */
KILN_CLONES static void find_points(const struct embree_backend *b, const struct tile_run_rays *rays,
                                    struct rays_found *restrict f)
{
    const uint32_t count = f->count;
    uint32_t split_count = 0;
    for (uint32_t i = 0; i < count; i++) {
        const struct kiln_tile *tile = f->tile[i];
        const uint64_t mask = tile->mask, first = tile->first, bit = 1ull << f->bit[i];
        if ((first & KILN_TILE_SPLIT) != 0) {
            const struct kiln_split_tile_run *parts = b->surface->splits + (first & ~KILN_TILE_SPLIT);
            __builtin_prefetch(parts);
            f->split_parts[split_count] = parts;
            f->split_hit[split_count++] = (uint8_t)i;
        }
        f->point[i] = (mask & bit) != 0 ? first + (uint64_t)__builtin_popcountll(mask & (bit - 1)) : KILN_NO_POINT;
        if ((first & KILN_TILE_SPLIT) == 0 && f->point[i] != KILN_NO_POINT)
            __builtin_prefetch(&b->radiosity[f->point[i]]);
    }
    for (uint32_t k = 0; k < split_count; k++) {
        const uint32_t i = f->split_hit[k];
        if (f->point[i] == KILN_NO_POINT)
            continue;
        const uint64_t bit = 1ull << f->bit[i];
        const struct kiln_split_tile_run *part = f->split_parts[k];
        while ((part->mask & bit) == 0)
            part++;
        f->point[i] = (part->first.at & KILN_TILE_SPLIT) != 0
                          ? of_divided(b, rays, f->lane[i], part->first)
                          : part->first.at + (uint64_t)__builtin_popcountll(part->mask & (bit - 1));
        __builtin_prefetch(&b->radiosity[f->point[i]]);
    }
}

void embree_find(const struct embree_backend *b, const struct tile_run_rays *rays, uint32_t lanes,
                 struct rays_found *found)
{
    find_tiles(b, rays, lanes, found);
    find_points(b, rays, found);
}
