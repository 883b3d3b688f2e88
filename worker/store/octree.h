/* The octree as a store (store.h, which includes this): light is stored in leaves (worker/scene/leaves.h). Lookup of a
 * hit: barycentrics -> leaf -> brick, through a hash table -> surface point. A brick is a tile, so the rest of the
 * lookup is the same as for lightmaps. It reads the surface's tables and the geometry's leaf records. */
#ifndef KILN_WORKER_STORE_OCTREE_H
#define KILN_WORKER_STORE_OCTREE_H

#include "shaders/shared/store_octree.h"
#include "worker/store/lightmap.h"

/* A leaf that a hit lies in. */
struct kiln_octree_leaf {
    uint64_t brick; /* kiln_brick_place */
    uint32_t map;   /* the octree, as in worker/scene/surface.h */
    uint32_t bit;   /* in the brick */
};

static inline struct kiln_octree_leaf kiln_octree_leaf(const struct kiln_store *store, uint32_t triangle, float u,
                                                       float v, bool back)
{
    const struct kiln_hit_record *r = &store->geometry->records[triangle];
    const struct kiln_leaf_record *leaf = &store->geometry->leaves[triangle];
    const uint32_t x = kiln_leaf_of(kiln_hit_x(r, u, v)), y = kiln_leaf_of(kiln_hit_y(r, u, v)),
                   layer = kiln_leaf_of(kiln_texel_coordinate(leaf->depth[0], leaf->depth[1], leaf->depth[2], u, v));
    return (struct kiln_octree_leaf){
        kiln_brick_place(x / KILN_BRICK_SIDE, y / KILN_BRICK_SIDE, layer / KILN_BRICK_SIDE),
        (leaf->side + (back ? KILN_SIDES : 0u)) * store->surface->object_count + r->object, kiln_morton4(x, y, layer)};
}

/* ---- one hit ---- */

static inline struct kiln_global_point kiln_octree_find(const struct kiln_store *store, uint32_t triangle, float u,
                                                        float v, bool back)
{
    const struct kiln_surface *s = store->surface;
    const struct kiln_octree_leaf leaf = kiln_octree_leaf(store, triangle, u, v, back);
    const struct kiln_brick_slot *slot = kiln_brick_slot(s, leaf.map, leaf.brick);
    if (slot->tile == 0)
        return (struct kiln_global_point){KILN_NO_POINT};
    return kiln_store_settle(store, triangle, u, v, back, kiln_tile_entry(s, &s->tiles[slot->tile - 1], leaf.bit));
}

/* ---- many hits ---- */

/* Places of hits in the octree, kept until their bricks are looked up. */
struct kiln_octree_ways {
    uint64_t brick[KILN_STORE_WAYS];
    uint32_t map[KILN_STORE_WAYS];
};

/* First round, instead of kiln_store_enter: from a hit to its hash table slot, which is prefetched. */
static inline void kiln_octree_enter(const struct kiln_store *store, struct kiln_octree_ways *octree,
                                     struct kiln_store_ways *ways, uint32_t i, uint32_t triangle, float u, float v,
                                     bool back)
{
    const struct kiln_octree_leaf leaf = kiln_octree_leaf(store, triangle, u, v, back);
    const struct kiln_surface *s = store->surface;
    __builtin_prefetch(
        &s->slots[kiln_brick_hash((uint32_t)leaf.brick, (uint32_t)(leaf.brick >> 32), leaf.map) & (s->slot_count - 1)]);
    octree->brick[i] = leaf.brick;
    octree->map[i] = leaf.map;
    ways->bit[i] = (uint8_t)leaf.bit;
}

/* Additional round for octrees: from slots to the bricks of all hits. kiln_store_follow comes next. */
static inline void kiln_octree_reach(const struct kiln_store *store, const struct kiln_octree_ways *octree,
                                     struct kiln_store_ways *ways, uint32_t count)
{
    static const struct kiln_tile none = {0, 0};
    const struct kiln_surface *s = store->surface;
    for (uint32_t i = 0; i < count; i++) {
        const struct kiln_brick_slot *slot = kiln_brick_slot(s, octree->map[i], octree->brick[i]);
        ways->tile[i] = slot->tile != 0 ? &s->tiles[slot->tile - 1] : &none;
        __builtin_prefetch(ways->tile[i]);
    }
}

#endif
