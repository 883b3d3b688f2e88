/* Chains of the weighed pass (worker/pass/weighed.h): as those of chain.h that look for lamps and sky, with a weight
 * for each path that they find. */
#ifndef KILN_WORKER_BACKEND_EMBREE_CHAIN_WEIGHED_H
#define KILN_WORKER_BACKEND_EMBREE_CHAIN_WEIGHED_H

#include "worker/backend/embree/chain.h"
#include "worker/pass/weighed.h"

/* Follows the chain of a ray that chain_begins is true of, of a point of which `area` m2 are there to be lit and that
 * has `samples` rays and these factors. `chance` and `k` as of chain_follow. `light`: what it finds, W/(m2 sr), by
 * colour, the ray's own tint left out. `sampled`: NULL; else `light` is what hits alone would find, and `sampled` what
 * samples of the lights would. */
void chain_follow_weighed(struct walk *walk, const struct kiln_caustic_techniques *techniques, double area,
                          uint32_t samples, const struct kiln_caustic_factors *factors, uint32_t chance, uint32_t k,
                          const struct RTCRayHit *ray, float light[3], float sampled[3]);

#endif
