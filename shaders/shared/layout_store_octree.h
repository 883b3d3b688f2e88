/* The octree as a store, on the device; part of shaders/shared/layout.h. */

struct kiln_gpu_leaf_record { /* struct kiln_leaf_record of worker/scene/geometry.h */
    KILN_REAL32 depth[3];
    KILN_WORD side;
};
KILN_SIZE_IS(kiln_gpu_leaf_record, 16);

struct kiln_gpu_brick_slot { /* struct kiln_brick_slot of worker/scene/surface.h */
    KILN_WORD64 place;
    KILN_WORD map, tile;
};
KILN_SIZE_IS(kiln_gpu_brick_slot, 16);

/* The arrays of kiln_store_arrays, in their order; those that a store does not use are empty. */
struct kiln_gpu_store {
    KILN_ADDRESS lightmaps, tiles, splits, divided, leaves, slots;
};
KILN_SIZE_IS(kiln_gpu_store, 48);
