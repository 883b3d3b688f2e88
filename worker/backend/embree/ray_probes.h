/* Gather rays that end at radiance probes (worker/pass/gather.h): which do, and what the probes send them. */
#ifndef KILN_WORKER_BACKEND_EMBREE_RAY_PROBES_H
#define KILN_WORKER_BACKEND_EMBREE_RAY_PROBES_H

#include "worker/backend/embree/hemisphere.h"
#include "worker/scene/radiance_probes.h"

struct ray_probes {
    float range;                     /* m: rays of points that see a probe end there */
    uint32_t near_probes[RAY_LANES]; /* of each valid point: the word of surface->near_probes */
    /* of each lane whether its point sees a probe, the distance at which it leaves the scene's box, and the probe that
     * it asks; and the lanes that ask, with the ends of their rays */
    bool sees[RAY_LANES];
    float far[RAY_LANES];
    uint32_t probe[RAY_LANES], asking;
    uint8_t asks[RAY_LANES];
    struct kiln_vec3 end[RAY_LANES];
};

/* Finds which probes the tile run's points see. */
void ray_probes_begin(struct ray_probes *p, const struct hemisphere *h, const struct embree_backend *b,
                      size_t tile_run);
/* Rays of points that see a probe end at the range; those of range 0 are none. Returns how many there are. */
uint64_t ray_probes_end_rays(struct ray_probes *p, struct hemisphere *h, uint32_t lanes);
/* Sorts the lanes that ended at the range: a ray that leaves the scene's box before has escaped. The others ask a probe
 * near the end of the ray, or where that is not seen from there one that the point sees. */
void ray_probes_choose(struct ray_probes *p, struct hemisphere *h, const struct embree_backend *b,
                       struct embree_context *context, uint32_t step);
/* Gives what a ray that asks a probe finds, as radiosity. */
void ray_probes_ask(const struct ray_probes *p, const struct hemisphere *h, const struct embree_backend *b, uint32_t l,
                    float rgb[3]);
/* Raises sums to zero: harmonics may be negative; a point's light is not. */
void ray_probes_raise_to_zero(struct hemisphere *h);

#endif
