/* Chains: continuation of a ray from a surface with simulated gloss until it ends at diffuse surfaces
 * (shaders/shared/chain.h has the rule). They are traced ray by ray, one thread a chain. */
#ifndef KILN_WORKER_BACKEND_EMBREE_CHAIN_H
#define KILN_WORKER_BACKEND_EMBREE_CHAIN_H

#include "worker/backend/embree/rays.h"
#include "worker/backend/embree/walk.h"

/* Light that a chain finds for the ray at whose hit it begins, by colour. The ray's own tint is left out. */
struct chain_found {
    float radiosity[3]; /* W/m2: radiosity of diffuse surfaces; divided by pi it is radiance */
    float light[3];     /* W/(m2 sr): light of lamps and sky by non-diffuse lobes */
    /* shares of the chain's light: escaped and from backs (means of the colours' weights), and absorbed or tinted by
     * the chain's surfaces; the rest comes from diffuse surfaces */
    float escaped, blocked, gloss[3];
};

/* Whether the scene has any surfaces at which chains begin. */
static inline bool chain_any(const struct embree_backend *b) { return b->lobes != NULL; }

/* Whether a chain begins at the surface that a ray hit; false if it hit none. */
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

/* Decides by chance whether a chain of this weight continues from its surface number `surface` (kiln_chain_chance); a
 * survivor's weight is increased. `pick`: rescaled random number that chooses a lobe. */
bool chain_survives(const struct walk *walk, const struct meeting *m, uint32_t surface, float weight[3], float *pick);

/* Traces the chain of a ray for which chain_begins is true. `chance` and `k`: seed of the rays' random decisions
 * (kiln_gather_chance) and number of the sample. `radiosity`: radiosity of diffuse surfaces is read. Lamps and sky are
 * sampled if the walk has choices. Of rays only shadow rays are counted. */
void chain_follow(struct walk *walk, uint32_t chance, uint32_t k, const struct RTCRayHit *ray, bool radiosity,
                  struct chain_found *found);

#endif
