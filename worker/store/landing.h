/* The surface point that light lands on at a hit (worker/pass/land.h). Inline: a step of hot loops. Thread-safe. */
#ifndef KILN_WORKER_STORE_LANDING_H
#define KILN_WORKER_STORE_LANDING_H

#include "worker/store/store.h"

/* Its global number; KILN_NO_POINT: none, also beyond a wall that divides the texel, for what lies there has the light
 * of another. The arguments are those of kiln_store_find. */
static inline uint64_t kiln_store_landing(const struct kiln_store *store, uint32_t triangle, float u, float v,
                                          bool back)
{
    const struct kiln_surface *s = store->surface;
    const struct kiln_hit_record *record = &store->geometry->records[triangle];
    if (s->bricks != NULL)
        return kiln_octree_find(store, triangle, u, v, back).at;
    const uint64_t at = kiln_store_find(store, triangle, u, v, back).at;
    if (s->divided_count == 0 || at == KILN_NO_POINT)
        return at;
    const struct kiln_lightmap *front = &s->lightmaps[record->object];
    const uint32_t number = record->object + (back ? s->object_count : 0u), shift = s->lightmaps[number].shift;
    const uint32_t x = (uint32_t)kiln_hit_column(record, u, v, front->width) >> shift,
                   y = (uint32_t)kiln_hit_row(record, u, v, front->height) >> shift;
    return kiln_surface_find(s, number, x, y).at == at ? at : KILN_NO_POINT;
}

#endif
