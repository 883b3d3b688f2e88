/* Chains of the weighed pass (worker/pass/weighed.h): as those of chain.h that look for lamps and sky, with a weight
 * for each path that they find. */
#ifndef KILN_WORKER_BACKEND_EMBREE_CHAIN_WEIGHED_H
#define KILN_WORKER_BACKEND_EMBREE_CHAIN_WEIGHED_H

#include "worker/backend/embree/chain.h"
#include "worker/pass/weighed.h"

/* What a chain finds, W/(m2 sr), by colour, the ray's own tint left out. */
struct chain_weighed {
    bool pilot; /* to be set before; else only `light` is filled in, with all that is found */
    /* of a pilot: by the techniques of enum kiln_caustic_gathers, whole or, of --mis optimal, by balance; and by
     * luminance what each exchange by 1 would add to the latter */
    float light[KILN_CAUSTIC_GATHERS][3];
    double exchanged[KILN_CAUSTIC_EXCHANGES];
};

/* Follows the chain of a ray that chain_begins is true of. `sums`: those with which the ray leaves its point, which has
 * these factors. `chance` and `k` as of chain_follow. */
void chain_follow_weighed(struct walk *walk, const struct kiln_caustic_techniques *techniques,
                          const struct kiln_caustic_gathered *sums, const struct kiln_caustic_factors *factors,
                          uint32_t chance, uint32_t k, const struct RTCRayHit *ray, struct chain_weighed *found);

#endif
