/* Radiosity at a hit. */
#ifndef KILN_WORKER_BACKEND_EMBREE_LOOKUP_H
#define KILN_WORKER_BACKEND_EMBREE_LOOKUP_H

#include "worker/backend/embree/rays.h"
#include "worker/scene/radiosity.h"

/* The surface point at a hit, and its packed radiosity (kiln_store_find); 0 beside every point. */
static inline struct kiln_global_point embree_point(const struct embree_backend *b, uint32_t triangle, float u, float v,
                                                    bool back)
{
    return b->store.surface->bricks != NULL ? kiln_octree_find(&b->store, triangle, u, v, back)
                                            : kiln_store_find(&b->store, triangle, u, v, back);
}
static inline uint64_t embree_radiosity(const struct embree_backend *b, uint32_t triangle, float u, float v, bool back)
{
    const struct kiln_global_point point = embree_point(b, triangle, u, v, back);
    return point.at == KILN_NO_POINT ? 0 : b->radiosity[point.at];
}

_Static_assert((int)RAY_LANES <= (int)KILN_STORE_WAYS, "the hits of a step are followed together");

/* Results of a step's rays, in the order of lanes. */
struct rays_found {
    uint32_t count; /* lanes that met a surface with radiosity, and these: */
    uint8_t lane[RAY_LANES];
    uint64_t point[RAY_LANES]; /* surface point or KILN_NO_POINT; its radiosity has been prefetched */
    uint32_t escaped, blocked; /* lanes that met nothing, and the back of a single-sided surface, and these: */
    uint8_t escaped_lane[RAY_LANES], blocked_lane[RAY_LANES];
    struct kiln_store_ways ways; /* to the points */
};

/* Makes the rounds to the bricks for embree_find, where the store is the octree (lookup_octree.c). */
void embree_enter_octrees(const struct embree_backend *b, const struct tile_run_rays *rays, uint32_t lanes,
                          struct rays_found *restrict found);

/* Finds the surface points that traced rays met: the store's rounds (worker/store/store.h). The last round, reading the
 * radiosity that was asked for, is the caller's. */
void embree_find(const struct embree_backend *b, const struct tile_run_rays *rays, uint32_t lanes,
                 struct rays_found *found);
/* rays_trace and embree_find: a packet's hits enter the store while the next packet is traced. */
void embree_trace_and_find(const struct embree_backend *b, struct embree_context *context, struct tile_run_rays *rays,
                           uint32_t lanes, struct rays_found *found);

#endif
