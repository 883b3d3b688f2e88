/* Radiosity at a hit. */
#ifndef KILN_WORKER_BACKEND_EMBREE_LOOKUP_H
#define KILN_WORKER_BACKEND_EMBREE_LOOKUP_H

#include "worker/backend/embree/embree.h"
#include "worker/scene/radiosity.h"

/* Barycentrics -> texel -> surface point, of the triangle's front or (`back`, where it has two sides) of its back.
 * KILN_NO_POINT for a hit beside every point (a sliver without texels). */
static inline struct kiln_global_point embree_point(const struct embree_backend *b, uint32_t triangle, float u, float v,
                                                    bool back)
{
    const struct kiln_hit_record *record = &b->params.geometry->records[triangle];
    const struct kiln_lightmap *front = &b->surface->lightmaps[record->object];
    const uint32_t number = record->object + (back ? b->surface->object_count : 0u),
                   shift = b->surface->lightmaps[number].shift;
    const uint32_t x = (uint32_t)kiln_hit_column(record, u, v, front->width),
                   y = (uint32_t)kiln_hit_row(record, u, v, front->height);
    return kiln_surface_find(b->surface, number, x >> shift, y >> shift);
}

/* Packed radiosity there; 0 beside every point. */
static inline uint64_t embree_radiosity(const struct embree_backend *b, uint32_t triangle, float u, float v, bool back)
{
    const struct kiln_global_point point = embree_point(b, triangle, u, v, back);
    return point.at == KILN_NO_POINT ? 0 : b->radiosity[point.at];
}

#endif
