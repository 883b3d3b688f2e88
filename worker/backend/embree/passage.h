/* Rays through surfaces that let light through: masks, blended surfaces, thin glass (struct kiln_passage in
 * worker/scene/texture.h).
 *
 * A shadow ray brings the product of what all surfaces on its way let through: no chance, no noise. A ray that looks
 * for the surface it meets takes each surface for there or not, with a chance that is its opacity, by a hash of the
 * ray's seed and the triangle; what the passed ones tint on its way to the hit multiplies what it finds. Masks leave
 * nothing to chance.
 *
 * Embree calls filters in any order, also for what lies behind the hit that it ends with. So a product is a sum of
 * optical depths, -log2 of what is let through, in fixed point; and the tint is found by a second look at the same ray,
 * up to its hit, which only rays take that have passed something with a colour.
 *
 * Each triangle must be asked once by a shadow ray. So the BVH has no spatial splits, and these rays are traced as
 * incoherent ones: Embree 3.13 traces coherent packets of shadow rays so that a triangle is asked up to 8 times for one
 * ray. */
#ifndef KILN_WORKER_BACKEND_EMBREE_PASSAGE_H
#define KILN_WORKER_BACKEND_EMBREE_PASSAGE_H

#include <string.h>

#include "shaders/shared/streams.h"
#include "worker/backend/embree/embree.h"

/* Seed of a ray's chances with surfaces that are partly there: the same ray always decides alike. */
static inline uint32_t kiln_ray_seed(struct kiln_vec3 origin, struct kiln_vec3 direction)
{
    uint32_t o[3], d[3];
    memcpy(o, &origin, sizeof o);
    memcpy(d, &direction, sizeof d);
    return kiln_ray_bits_seed(o[0], o[1], o[2], d[0], d[1], d[2]);
}

enum embree_question {
    /* which is the nearest surface that lets no light through at all? for what tells solids by; chance has no part */
    EMBREE_SOLID,
    EMBREE_BY_CHANCE, /* which is the nearest that chance takes for there? */
    EMBREE_TINT,      /* what do those let through that chance has passed? */
    EMBREE_THROUGH    /* what do all let through? */
};

/* Context that a thread's rays are traced with; made by embree_context. */
struct embree_context {
    struct RTCIntersectContext rtc; /* first: filters are given its address */
    enum embree_question question;
    uint32_t seed[PACKET];    /* of each ray */
    int64_t depth[PACKET][3]; /* optical depth so far, of each colour, in units of 2^-40 */
    bool tinted[PACKET];      /* has passed something with a colour */
};

/* Context for incoherent or (few triangles) coherent packets. */
void embree_context(const struct embree_backend *b, struct embree_context *context);
/* Context for rays, one by one or in packets, that ask EMBREE_SOLID. */
void embree_context_solid(struct embree_context *context);

/* Registers what the scene needs with the geometry of its triangles that are not opaque. */
void embree_set_filters(const struct embree_backend *b, RTCGeometry geometry);

/* Whether shadow rays may come through in part, and whether nearest hits may be tinted: without, the functions below
 * leave `through` or `tint` as they are, and seeds are not looked at. */
static inline bool embree_blends(const struct embree_backend *b)
{
    return b->params.geometry->passage >= KILN_PASSAGE_BLEND;
}
static inline bool embree_tints(const struct embree_backend *b)
{
    return b->params.geometry->passage >= KILN_PASSAGE_TINT;
}

/* Nearest hits; of a front and a back that coincide, the front, where the scene has such faces (KILN_COINCIDENT in
 * shaders/shared/surface.h). `tint`: share of what is found there that arrives, of each colour. `valid`: -1 for a ray,
 * 0 for none. */
void embree_nearest8(const struct embree_backend *b, struct embree_context *context, const int *valid,
                     struct RTCRayHit8 *rays, const uint32_t seed[PACKET], float tint[PACKET][3]);
void embree_nearest1(const struct embree_backend *b, struct embree_context *context, struct RTCRayHit *ray,
                     uint32_t seed, float tint[3]);
/* Whether anything is met, by the same chances: tfar is then negative. */
void embree_blocked8(const struct embree_backend *b, struct embree_context *context, const int *valid,
                     struct RTCRay8 *rays, const uint32_t seed[PACKET]);
/* Shadow rays: tfar is negative where nothing comes through; else `through` is the share that does, of each colour. */
void embree_through8(const struct embree_backend *b, struct embree_context *context, const int *valid,
                     struct RTCRay8 *rays, double through[PACKET][3]);
void embree_through1(const struct embree_backend *b, struct embree_context *context, struct RTCRay *ray,
                     double through[3]);
/* The same between two places: what a connection lets through; false: nothing. */
bool passage_between(const struct embree_backend *b, struct embree_context *context, struct kiln_vec3 from,
                     struct kiln_vec3 to, double through[3]);

/* How far a ray that begins at p, offset included, is lifted along n instead of `lift` m: not through what lies above
 * (KILN_LIFT_CLEAR). */
float embree_clear_lift(const struct embree_backend *backend, struct kiln_vec3 p, struct kiln_vec3 n, float lift);

#endif
