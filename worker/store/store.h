/* A store is where the light of surfaces lives, and the way to it from a ray's hit. Its places are numbered from 0 on;
 * the radiosity of all places is one array by that number, in the packed form of worker/scene/radiosity.h, which ranks
 * exchange and backends read (kiln_backend_set_radiosity). A place is a surface point, by its global number.
 *
 * There are two, and a surface has one of them: the lightmap (lightmap.h), whose points are texels, and the octree
 * (octree.h), whose points are leaves; the surface's `bricks` says which. Both have the same struct kiln_store, tiles,
 * splits and divided texels; only the way from a hit to its tile differs. What follows is of both but for
 * kiln_store_find and kiln_store_enter, which are the lightmap's: kiln_octree_find, kiln_octree_enter and
 * kiln_octree_reach stand in for these. Whoever follows hits chooses once for many of them, so that a loop over hits
 * has no pointer to go through; kernels have a constant (HAS_OCTREE of shaders/kernel.glsl). A store gives
 *
 *   build   struct kiln_store, what the way reads, from the surface and the geometry
 *   count   the number of its places
 *   bytes   the memory that the way takes, and its arrays, which a device copies
 *   find    the place of a hit, in one go or in rounds
 *
 * A new store called NAME whose places are points of tiles, too, is worker/store/NAME.h with its way to the tile,
 * shaders/store_NAME.glsl and the structs of its arrays in shaders/shared/layout_store_NAME.h; its arrays in
 * kiln_store_arrays; and the choice in worker/backend/embree/lookup.c and .h and in shaders/store_lightmap.glsl. */
#ifndef KILN_WORKER_STORE_STORE_H
#define KILN_WORKER_STORE_STORE_H

#include "worker/scene/geometry.h"
#include "worker/scene/surface.h"

struct kiln_store;
struct kiln_store_ways;

/* ---- build, count, bytes ---- */

/* Makes the store of a surface. It borrows both, whose arrays may move as long as the structs stay; there is nothing to
 * release. */
void kiln_store_build(struct kiln_store *store, const struct kiln_surface *surface,
                      const struct kiln_geometry *geometry);

uint64_t kiln_store_count(const struct kiln_store *store);

/* An array that the way reads. */
struct kiln_store_array {
    const void *data;
    size_t bytes;
    const char *what; /* in messages: "the lightmap tiles" */
};
/* All of them: KILN_STORE_ARRAYS, in the order of struct kiln_gpu_store. */
void kiln_store_arrays(const struct kiln_store *store, struct kiln_store_array *arrays);
/* Bytes of all arrays that the way reads. The arrays are the same on all ranks, and are there once on each node. */
uint64_t kiln_store_bytes(const struct kiln_store *store);

/* ---- find ---- */

/* The place of the hit (u, v) on a world triangle's front or (`back`, where it has two sides) on its back;
 * KILN_NO_POINT: beside every place. */
static inline struct kiln_global_point kiln_store_find(const struct kiln_store *store, uint32_t triangle, float u,
                                                       float v, bool back);

/* The same for many hits, up to KILN_STORE_WAYS, in rounds: each asks memory for what the next one reads, for the way
 * to memory is as long as tracing a ray. First every hit enters as number i, from 0 on. Then all are followed to their
 * places, and the radiosity of these is asked for; the places of some hits, whose numbers are ways->open[0 .. the
 * number that is returned), are not settled: kiln_store_settle does that. */
static inline void kiln_store_enter(const struct kiln_store *store, struct kiln_store_ways *ways, uint32_t i,
                                    uint32_t triangle, float u, float v, bool back);
static inline uint32_t kiln_store_follow(const struct kiln_store *store, struct kiln_store_ways *ways, uint32_t count,
                                         const uint64_t *radiosity, uint64_t *places);
/* The place of a hit of which the way came as far as `place`. */
static inline struct kiln_global_point kiln_store_settle(const struct kiln_store *store, uint32_t triangle, float u,
                                                         float v, bool back, struct kiln_global_point place);

#include "worker/store/lightmap.h"
#include "worker/store/octree.h"

#endif
