#include "worker/store/store.h"

#include "worker/base/vector.h"
#include "shaders/shared/layout.h"

/* Copied to a device as they are. */
_Static_assert(sizeof(struct kiln_gpu_divided) == sizeof(struct kiln_divided_texel), "divided texels");
_Static_assert(sizeof(struct kiln_gpu_lightmap) == sizeof(struct kiln_lightmap), "lightmaps");
_Static_assert(sizeof(struct kiln_gpu_leaf_record) == sizeof(struct kiln_leaf_record), "the leaves' records");
_Static_assert(sizeof(struct kiln_gpu_brick_slot) == sizeof(struct kiln_brick_slot), "the slots of bricks");
_Static_assert(sizeof(struct kiln_gpu_tile) == sizeof(struct kiln_tile) &&
                   sizeof(struct kiln_gpu_tile) == sizeof(struct kiln_split_tile_run),
               "tiles");

void kiln_store_build(struct kiln_store *store, const struct kiln_surface *surface,
                      const struct kiln_geometry *geometry)
{
    *store = (struct kiln_store){.surface = surface, .geometry = geometry};
}

uint64_t kiln_store_count(const struct kiln_store *store) { return store->surface->point_count; }

void kiln_store_arrays(const struct kiln_store *store, struct kiln_store_array *arrays)
{
    const struct kiln_surface *s = store->surface;
    const struct kiln_geometry *g = store->geometry;
    const struct kiln_store_array all[KILN_STORE_ARRAYS] = {
        {s->lightmaps, s->map_count * sizeof *s->lightmaps, "the lightmaps' sizes"},
        {s->tiles, s->tile_count * sizeof *s->tiles, "the tiles of the lightmaps"},
        {s->splits, s->split_count * sizeof *s->splits, "the tiles of the lightmaps"},
        {s->divided, s->divided_count * sizeof *s->divided, "the texels that walls divide"},
        {g->leaves, s->bricks != NULL ? g->triangle_count * sizeof *g->leaves : 0, "the leaves' records"},
        {s->slots, s->slot_count * sizeof *s->slots, "the slots of bricks"}};
    for (size_t i = 0; i < KILN_STORE_ARRAYS; i++)
        arrays[i] = all[i];
}

uint64_t kiln_store_bytes(const struct kiln_store *store)
{
    struct kiln_store_array arrays[KILN_STORE_ARRAYS];
    uint64_t bytes = 0;
    kiln_store_arrays(store, arrays);
    for (size_t i = 0; i < KILN_STORE_ARRAYS; i++)
        bytes += arrays[i].bytes;
    return bytes;
}
