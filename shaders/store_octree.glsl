/* The octree as a store (worker/store/octree.h): barycentrics -> leaf -> brick, through the hash table. A brick is a
 * tile; from there on the lookup is that of store_lightmap.glsl, which includes this file. */

#include "shaders/shared/store_octree.h"

KILN_ARRAY(LeafRecords, kiln_gpu_leaf_record, 4);
KILN_ARRAY(BrickSlots, kiln_gpu_brick_slot, 8);

/* Address of a brick's tile; 0: no such brick. */
uint64_t kiln_brick_tile(uint low, uint high, uint octree)
{
    const uint64_t place = uint64_t(high) << 32 | low, last = SCENE.slot_last;
    uint64_t i = uint64_t(kiln_brick_hash(low, high, octree)) & last;
    kiln_gpu_brick_slot slot = BrickSlots(SCENE.store.slots + i * 16ul).at[0];
    while (slot.tile != 0u && (slot.place != place || slot.map != octree)) {
        i = (i + 1ul) & last;
        slot = BrickSlots(SCENE.store.slots + i * 16ul).at[0];
    }
    return slot.tile == 0u ? 0ul : SCENE.store.tiles + uint64_t(slot.tile - 1u) * 16ul;
}

/* Finds tile and bit of a hit at (along, down) on a triangle of `object`. */
void kiln_octree_enter(uint triangle, float u, float v, bool back, uint object, float along, float down,
                       out uint64_t tile, out uint bit)
{
    const kiln_gpu_leaf_record leaf = LeafRecords(SCENE.store.leaves + uint64_t(triangle) * 16ul).at[0];
    const uint x = kiln_leaf_of(along), y = kiln_leaf_of(down),
               layer = kiln_leaf_of(kiln_texel_coordinate(leaf.depth[0], leaf.depth[1], leaf.depth[2], u, v));
    const uint octree = (leaf.side + (back ? uint(KILN_SIDES) : 0u)) * SCENE.object_count + object;
    const uint side = uint(KILN_BRICK_SIDE);
    tile = kiln_brick_tile(kiln_brick_low(x / side, y / side), kiln_brick_high(y / side, layer / side), octree);
    bit = kiln_morton4(x, y, layer);
}
