/* A store holds the light of surfaces, and finds the place of the light for a ray's hit. A place is a surface point, by
 * its global number, from 0 on. The radiosity of all places is one array, indexed by this number, in the packed form of
 * worker/scene/radiosity.h. Ranks exchange this array and backends read it (kiln_backend_set_radiosity).
 *
 * There are two kinds of stores, and a surface has one of them: the lightmap (lightmap.h), whose points are texels, and
 * the octree (octree.h), whose points are leaves; the surface's `bricks` says which. Both have the same struct
 * kiln_store, tiles, splits and divided texels; only the lookup from a hit to its tile differs. The functions below
 * serve both kinds, except kiln_store_find and kiln_store_enter, which are for lightmaps; octrees have
 * kiln_octree_find, kiln_octree_enter and kiln_octree_reach. Callers choose the kind once for many hits, so that loops
 * over hits need no function pointer; kernels have a constant (HAS_OCTREE of shaders/kernel.glsl). A store provides
 *
 *   build   struct kiln_store, the data that the lookup reads, from the surface and the geometry
 *   count   the number of its places
 *   bytes   the memory that the lookup needs, and its arrays, which a device copies
 *   find    the place of a hit, in one go or in rounds
 *
 * To add a store called NAME, whose places are also points of tiles, write worker/store/NAME.h with its lookup of the
 * tile, shaders/store_NAME.glsl and the structs of its arrays in shaders/shared/layout_store_NAME.h; add its arrays to
 * kiln_store_arrays, and the choice of the store to worker/backend/embree/lookup.c and .h and to
 * shaders/store_lightmap.glsl. */
#ifndef KILN_WORKER_STORE_STORE_H
#define KILN_WORKER_STORE_STORE_H

#include "worker/scene/geometry.h"
#include "worker/scene/surface.h"

struct kiln_store;
struct kiln_store_ways;

/* ---- build, count, bytes ---- */

/* Makes the store of a surface. Surface and geometry are borrowed; their arrays may move as long as the structs stay.
 * Nothing has to be released. */
void kiln_store_build(struct kiln_store *store, const struct kiln_surface *surface,
                      const struct kiln_geometry *geometry);

uint64_t kiln_store_count(const struct kiln_store *store);

/* An array that the lookup reads. */
struct kiln_store_array {
    const void *data;
    size_t bytes;
    const char *what; /* in messages: "the lightmap tiles" */
};
/* Lists all KILN_STORE_ARRAYS arrays, in the order of struct kiln_gpu_store. */
void kiln_store_arrays(const struct kiln_store *store, struct kiln_store_array *arrays);
/* Size of all arrays that the lookup reads, bytes. The arrays are the same on all ranks, and exist once on each node.
 */
uint64_t kiln_store_bytes(const struct kiln_store *store);

/* ---- find ---- */

/* Finds the place of the hit (u, v) on a world triangle's front or (`back`, only for double-sided ones) back;
 * KILN_NO_POINT: no place there. */
static inline struct kiln_global_point kiln_store_find(const struct kiln_store *store, uint32_t triangle, float u,
                                                       float v, bool back);

/* Lookup of many hits, up to KILN_STORE_WAYS, in rounds. Each round prefetches the memory that the next one reads,
 * since a memory access takes as long as tracing a ray. First every hit i, from 0 on, is entered. Then
 * kiln_store_follow finds the places of all hits and prefetches their radiosity. It returns the number of hits,
 * ways->open[0 ..], whose place is not final: kiln_store_settle finds it. */
static inline void kiln_store_enter(const struct kiln_store *store, struct kiln_store_ways *ways, uint32_t i,
                                    uint32_t triangle, float u, float v, bool back);
static inline uint32_t kiln_store_follow(const struct kiln_store *store, struct kiln_store_ways *ways, uint32_t count,
                                         const uint64_t *radiosity, uint64_t *places);
/* Finishes the lookup of a hit that kiln_store_follow led to `place`. */
static inline struct kiln_global_point kiln_store_settle(const struct kiln_store *store, uint32_t triangle, float u,
                                                         float v, bool back, struct kiln_global_point place);

#include "worker/store/lightmap.h"
#include "worker/store/octree.h"

#endif
