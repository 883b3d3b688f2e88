/* Rays through surfaces that let light through: masks, blended surfaces, thin glass (struct kiln_passage in
 * worker/scene/texture.h).
 *
 * A shadow ray computes the product of the transmittances of all surfaces along it, without chance or noise. A ray that
 * looks for the nearest surface hits each surface with a probability equal to its opacity, by a hash of the ray's seed
 * and the triangle. The tints of the surfaces that it passes multiply what it finds. Masks involve no chance.
 *
 * Embree calls filters in any order, also for surfaces behind the final hit. So a product is stored as a sum of optical
 * depths, -log2 of transmittance, in fixed point. And the tint is found by tracing the same ray again, up to its hit,
 * if it has passed a coloured surface.
 *
 * A shadow ray's filter must see each triangle once. So the BVH has no spatial splits, and these rays are traced as
 * incoherent ones: in coherent packets of shadow rays Embree 3.13 calls the filter up to 8 times for one triangle and
 * ray. */
#ifndef KILN_WORKER_BACKEND_EMBREE_PASSAGE_H
#define KILN_WORKER_BACKEND_EMBREE_PASSAGE_H

#include <string.h>

#include "shaders/shared/streams.h"
#include "worker/backend/embree/embree.h"

/* Returns the seed of a ray's random decisions at partly transparent surfaces: the same ray always decides alike. */
static inline uint32_t kiln_ray_seed(struct kiln_vec3 origin, struct kiln_vec3 direction)
{
    uint32_t o[3], d[3];
    memcpy(o, &origin, sizeof o);
    memcpy(d, &direction, sizeof d);
    return kiln_ray_bits_seed(o[0], o[1], o[2], d[0], d[1], d[2]);
}

enum embree_question {
    /* the nearest surface that lets no light through at all; for detecting solids, without chance */
    EMBREE_SOLID,
    EMBREE_BY_CHANCE, /* the nearest surface that chance lets the ray hit */
    EMBREE_TINT,      /* the transmittance of the surfaces that chance lets the ray pass */
    EMBREE_THROUGH    /* the transmittance of all surfaces */
};

/* Context that a thread's rays are traced with; made by embree_context. */
struct embree_context {
    struct RTCIntersectContext rtc; /* first: filters are given its address */
    enum embree_question question;
    uint32_t seed[PACKET];    /* seed of each ray */
    int64_t depth[PACKET][3]; /* optical depth so far, of each colour, in units of 2^-40 */
    bool tinted[PACKET];      /* the ray has passed a coloured surface */
};

/* Context for incoherent or (few triangles) coherent packets. */
void embree_context(const struct embree_backend *b, struct embree_context *context);
/* Makes a context for rays, one by one or in packets, with the question EMBREE_SOLID. */
void embree_context_solid(struct embree_context *context);

/* Registers the scene's filters with the geometry of its non-opaque triangles. */
void embree_set_filters(const struct embree_backend *b, RTCGeometry geometry);

/* embree_blends: whether shadow rays may be partly transmitted; embree_tints: whether nearest hits may be tinted. If
 * not, the functions below leave `through` or `tint` unchanged and ignore seeds. */
static inline bool embree_blends(const struct embree_backend *b)
{
    return b->params.geometry->passage >= KILN_PASSAGE_BLEND;
}
static inline bool embree_tints(const struct embree_backend *b)
{
    return b->params.geometry->passage >= KILN_PASSAGE_TINT;
}

/* Finds nearest hits. Of a coincident front and back it takes the front, if the scene has such faces (KILN_COINCIDENT
 * in shaders/shared/surface.h). `tint`: transmittance up to the hit, by colour. `valid`: -1 for a ray, 0 for none. */
void embree_nearest8(const struct embree_backend *b, struct embree_context *context, const int *valid,
                     struct RTCRayHit8 *rays, const uint32_t seed[PACKET], float tint[PACKET][3]);
void embree_nearest1(const struct embree_backend *b, struct embree_context *context, struct RTCRayHit *ray,
                     uint32_t seed, float tint[3]);
/* Finds whether a ray hits anything, by the same random decisions: tfar is negative if so. */
void embree_blocked8(const struct embree_backend *b, struct embree_context *context, const int *valid,
                     struct RTCRay8 *rays, const uint32_t seed[PACKET]);
/* Traces shadow rays: tfar is negative if blocked; else `through` is the transmittance, by colour. */
void embree_through8(const struct embree_backend *b, struct embree_context *context, const int *valid,
                     struct RTCRay8 *rays, double through[PACKET][3]);
void embree_through1(const struct embree_backend *b, struct embree_context *context, struct RTCRay *ray,
                     double through[3]);
/* Finds the transmittance between two places, for a connection; false: blocked. */
bool passage_between(const struct embree_backend *b, struct embree_context *context, struct kiln_vec3 from,
                     struct kiln_vec3 to, double through[3]);

/* Returns the lift, m along n, of a ray that begins at p, offset included: at most `lift`, and limited by surfaces
 * above (KILN_LIFT_CLEAR). */
float embree_clear_lift(const struct embree_backend *backend, struct kiln_vec3 p, struct kiln_vec3 n, float lift);

#endif
