/* Chains of the weighed pass (worker/pass/weighed.h): as those of chain.h that look for lamps and sky, with a weight
 * for each path that they find. */
#ifndef KILN_WORKER_BACKEND_EMBREE_CHAIN_WEIGHED_H
#define KILN_WORKER_BACKEND_EMBREE_CHAIN_WEIGHED_H

#include "worker/backend/embree/chain.h"
#include "worker/pass/weighed.h"

/* Follows the chain of a ray that chain_begins is true of. `sums`: those with which the ray leaves its point. `chance`
 * and `k` as of chain_follow. `light` is set to what the chain finds, W/(m2 sr), by colour, the ray's own tint left
 * out. */
void chain_follow_weighed(struct walk *walk, const struct kiln_caustic_techniques *techniques,
                          const struct kiln_caustic_gathered *sums, uint32_t chance, uint32_t k,
                          const struct RTCRayHit *ray, float light[3]);

#endif
