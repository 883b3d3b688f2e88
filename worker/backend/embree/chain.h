/* Chains: how a ray goes on from a surface whose material is taken with its gloss, until diffuse surfaces answer
 * (shaders/shared/chain.h has the rule). Followed ray by ray, one thread a chain. */
#ifndef KILN_WORKER_BACKEND_EMBREE_CHAIN_H
#define KILN_WORKER_BACKEND_EMBREE_CHAIN_H

#include "worker/backend/embree/rays.h"
#include "worker/backend/embree/walk.h"

/* Light that a chain finds for the ray at whose hit it begins, by colour. The ray's own tint is left out. */
struct chain_found {
    float radiosity[3]; /* W/m2: of diffuse surfaces; times 1 / pi it is radiance */
    float light[3];     /* W/(m2 sr): of lamps and sky, by lobes that are not diffuse alone */
    /* shares of what comes that way: from nowhere and from backs (means of the colours' weights), and what the chain's
     * surfaces take, or tint, for themselves; what is left comes from diffuse surfaces */
    float escaped, blocked, gloss[3];
};

/* Whether light transport goes on in chains at all. */
static inline bool chain_any(const struct embree_backend *b) { return b->lobes != NULL; }

/* Whether a chain begins where a ray met a surface; false where it met none. */
static inline bool chain_begins(const struct embree_backend *b, const struct RTCRayHit *ray)
{
    return ray->hit.geomID != RTC_INVALID_GEOMETRY_ID && (meeting_record(b, ray)->material & KILN_RECORD_GLOSS) != 0 &&
           meeting_has_side(b, meeting_record(b, ray), meeting_is_back(ray));
}
static inline bool chain_begins_at(const struct embree_backend *b, const struct tile_run_rays *rays, uint32_t lane)
{
    const struct RTCRayHit ray = rays_lane(rays, lane);
    return chain_begins(b, &ray);
}

/* Whether a chain of this weight goes on from its surface number `surface` (kiln_chain_chance); then the weight counts
 * the more. `pick`: what of the random number chooses a lobe. */
bool chain_survives(const struct walk *walk, const struct meeting *m, uint32_t surface, float weight[3], float *pick);

/* Follows the chain of a ray that chain_begins is true of. `chance` and `k`: what the ray's chances hang on
 * (kiln_gather_chance) and the number of the sample. `radiosity`: diffuse surfaces are asked. Lamps and sky are looked
 * for where the walk has choices. Rays are not counted but for shadow rays. */
void chain_follow(struct walk *walk, uint32_t chance, uint32_t k, const struct RTCRayHit *ray, bool radiosity,
                  struct chain_found *found);

#endif
