/* Chains of the weighed pass (worker/pass/weighed.h): as chains of chain.h that sample lamps and sky, but with a weight
 * for each light path found. */
#ifndef KILN_WORKER_BACKEND_EMBREE_CHAIN_WEIGHED_H
#define KILN_WORKER_BACKEND_EMBREE_CHAIN_WEIGHED_H

#include "worker/backend/embree/chain.h"
#include "worker/pass/weighed.h"

/* Traces the chain of a ray for which chain_begins is true. `sums`: sums with which the ray leaves its point. `chance`
 * and `k` as for chain_follow. `light` is set to the chain's light, W/(m2 sr), by colour, without the ray's own tint.
 */
void chain_follow_weighed(struct walk *walk, const struct kiln_caustic_techniques *techniques,
                          const struct kiln_caustic_gathered *sums, uint32_t chance, uint32_t k,
                          const struct RTCRayHit *ray, float light[3]);

#endif
