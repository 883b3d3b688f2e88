/* What the passes over patches (worker/pass/patches.h, worker/pass/links.h) share: factors of a point, rays between two
 * patches. */
#ifndef KILN_WORKER_BACKEND_EMBREE_PATCH_FACTORS_H
#define KILN_WORKER_BACKEND_EMBREE_PATCH_FACTORS_H

#include "worker/backend/embree/passage.h"
#include "worker/pass/patches.h"

/* A point that gathers. */
struct patch_receiver {
    struct kiln_dvec3 n, s; /* geometric and shading normal, unit */
    bool smooth;            /* these may differ */
};

/* F about the geometric and the shading normal. */
struct patch_factors {
    double factor, shading;
};

/* Of a node's parallelogram at d, a distance whose square is `square`; `cosine` and `other`: d about the receiver's
 * normal and -d about the node's, both above 0. */
struct patch_factors patch_factors(const struct patch_receiver *receiver, const struct kiln_patch *from,
                                   struct kiln_dvec3 d, double square, double cosine, double other);

/* Ray i of a packet goes between two places. False: they are one place. */
bool patch_ray(struct RTCRay8 *rays, uint32_t i, struct kiln_vec3 from, struct kiln_vec3 to);

#endif
