/* Radiosity at a hit. */
#ifndef KILN_WORKER_BACKEND_EMBREE_LOOKUP_H
#define KILN_WORKER_BACKEND_EMBREE_LOOKUP_H

#include "worker/backend/embree/rays.h"
#include "worker/scene/radiosity.h"

/* Returns the surface point at a hit, and its packed radiosity (kiln_store_find); 0 where there is no point. */
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
    uint32_t count; /* number of lanes that hit a surface with radiosity; `lane` lists them */
    uint8_t lane[RAY_LANES];
    uint64_t point[RAY_LANES]; /* surface point or KILN_NO_POINT; its radiosity has been prefetched */
    uint32_t escaped, blocked; /* numbers of lanes that hit nothing, and that hit a single-sided surface's back: */
    uint8_t escaped_lane[RAY_LANES], blocked_lane[RAY_LANES];
    struct kiln_store_ways ways; /* prefetches on the way to the points */
};

/* First lookup rounds of embree_find, down to the bricks, if the store is the octree (lookup_octree.c). */
void embree_enter_octrees(const struct embree_backend *b, const struct tile_run_rays *rays, uint32_t lanes,
                          struct rays_found *restrict found);

/* Finds the surface points that traced rays hit: the store's rounds of prefetching (worker/store/store.h). The caller
 * does the last round: it reads the prefetched radiosity. */
void embree_find(const struct embree_backend *b, const struct tile_run_rays *rays, uint32_t lanes,
                 struct rays_found *found);
/* Combines rays_trace and embree_find: a packet's hits enter the store's lookup while the next packet is traced. */
void embree_trace_and_find(const struct embree_backend *b, struct embree_context *context, struct tile_run_rays *rays,
                           uint32_t lanes, struct rays_found *found);

#endif
