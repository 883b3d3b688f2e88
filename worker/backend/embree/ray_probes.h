/* Gather rays that end at radiance probes (worker/pass/gather.h): selection of these rays, and lookup of the probes'
 * radiance. */
#ifndef KILN_WORKER_BACKEND_EMBREE_RAY_PROBES_H
#define KILN_WORKER_BACKEND_EMBREE_RAY_PROBES_H

#include "worker/backend/embree/hemisphere.h"
#include "worker/scene/radiance_probes.h"

struct ray_probes {
    float range;                     /* m: rays of points that see a probe end there */
    uint32_t near_probes[RAY_LANES]; /* word of surface->near_probes for each valid point */
    /* for each lane: whether its point sees a probe, the distance at which the ray leaves the scene's box, and the
     * chosen probe; then the number and list of the lanes that look up a probe, with the ends of their rays */
    bool sees[RAY_LANES];
    float far[RAY_LANES];
    uint32_t probe[RAY_LANES], asking;
    uint8_t asks[RAY_LANES];
    struct kiln_vec3 end[RAY_LANES];
};

/* Finds the probes that the tile run's points see. */
void ray_probes_begin(struct ray_probes *p, const struct hemisphere *h, const struct embree_backend *b,
                      size_t tile_run);
/* Limits the rays of points that see a probe to the range; with range 0 they are not traced. Returns the number of
 * remaining rays. */
uint64_t ray_probes_end_rays(struct ray_probes *p, struct hemisphere *h, uint32_t lanes);
/* Processes the lanes whose rays ended at the range. A ray that leaves the scene's box before that has escaped. The
 * others choose a probe near the end of the ray or, if none is visible from there, one that the point sees. */
void ray_probes_choose(struct ray_probes *p, struct hemisphere *h, const struct embree_backend *b,
                       struct embree_context *context, uint32_t step);
/* Returns the radiosity that the probe gives to lane l's ray. */
void ray_probes_ask(const struct ray_probes *p, const struct hemisphere *h, const struct embree_backend *b, uint32_t l,
                    float rgb[3]);
/* Raises negative sums to zero: harmonics may be negative, a point's light is not. */
void ray_probes_raise_to_zero(struct hemisphere *h);

#endif
