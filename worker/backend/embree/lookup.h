/* Radiosity at a hit. */
#ifndef KILN_WORKER_BACKEND_EMBREE_LOOKUP_H
#define KILN_WORKER_BACKEND_EMBREE_LOOKUP_H

#include "worker/backend/embree/rays.h"
#include "worker/scene/radiosity.h"

/* The point that an entry of the map (kiln_surface_entry) at a hit stands for. */
static inline struct kiln_global_point embree_of_divided(const struct embree_backend *b,
                                                         const struct kiln_hit_record *record, float u, float v,
                                                         uint32_t shift, struct kiln_global_point entry)
{
    if ((entry.at & KILN_TILE_SPLIT) == 0 || entry.at == KILN_NO_POINT)
        return entry;
    const float scale = 1.0f / (float)(1u << shift), x = kiln_hit_x(record, u, v) * scale,
                y = kiln_hit_y(record, u, v) * scale;
    return kiln_divided_choose(&b->surface->divided[entry.at & ~KILN_TILE_SPLIT], x - floorf(x), y - floorf(y));
}

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
    const struct kiln_global_point entry = kiln_surface_entry(b->surface, number, x >> shift, y >> shift);
    return embree_of_divided(b, record, u, v, shift, entry);
}

/* Packed radiosity there; 0 beside every point. */
static inline uint64_t embree_radiosity(const struct embree_backend *b, uint32_t triangle, float u, float v, bool back)
{
    const struct kiln_global_point point = embree_point(b, triangle, u, v, back);
    return point.at == KILN_NO_POINT ? 0 : b->radiosity[point.at];
}

/* What a step's rays met, in the order of lanes. */
struct rays_found {
    uint32_t count; /* lanes that met a surface with radiosity, and these: */
    uint8_t lane[RAY_LANES];
    uint64_t point[RAY_LANES]; /* surface point or KILN_NO_POINT; its radiosity has been prefetched */
    uint32_t escaped, blocked; /* lanes that met nothing, and the back of a single-sided surface, and these: */
    uint8_t escaped_lane[RAY_LANES], blocked_lane[RAY_LANES];
    /* on the way there */
    const struct kiln_tile *tile[RAY_LANES];
    const struct kiln_split_tile_run *split_parts[RAY_LANES];
    uint8_t bit[RAY_LANES], split_hit[RAY_LANES];
};

/* Finds the surface points that traced rays met. From hits to radiosity it goes in three rounds, the last of which is
 * the caller's, so that each load has been asked for a round before: the way to memory is as long as tracing a ray. */
void embree_find(const struct embree_backend *b, const struct tile_run_rays *rays, uint32_t lanes,
                 struct rays_found *found);

#endif
