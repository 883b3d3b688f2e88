/* A surface hit by a light path, seen from the side of arrival: position, normals and scattering. Shared by the passes
 * that follow paths ray by ray. Thread-safe. */
#ifndef KILN_WORKER_BACKEND_EMBREE_MEETING_H
#define KILN_WORKER_BACKEND_EMBREE_MEETING_H

#include "shaders/shared/path.h"
#include "worker/backend/embree/passage.h"
#include "worker/material/surface_bsdf.h"

/* Surface hit of a path, seen from the side of arrival. */
struct meeting {
    uint32_t triangle, stored;
    const struct kiln_mesh *mesh;
    float u, v, b1, b2; /* barycentric weights of the world triangle's corners, and of the stored triangle's */
    bool back;
    struct kiln_vec3 position, normal, shading; /* normals: geometric and of the mesh */
    float offset;                               /* m: offset along the normal at which rays start */
    /* set by meeting_lift. `coarse`: the triangle is a coarse facet of a smooth mesh. `lifted`: rays start `lift` m
     * above the offset, and light counts if the shading normal faces it, even from below the facet */
    bool coarse, lifted;
    float lift;
    /* gloss of a surface that is not purely diffuse; NULL: purely diffuse */
    const struct kiln_gloss *gloss;
    struct kiln_frame frame; /* frame of the front */
    struct kiln_bsdf_lobes lobes;
    struct kiln_vec3 o;             /* direction towards the path's origin, in the frame */
    struct kiln_bsdf_albedo albedo; /* albedo of the lobes for o */
    struct kiln_bsdf_choice shares; /* probabilities of the lobes, by luminance */
    /* non-diffuse lobes; `sharp`: those of them whose light is found by the path's own rays */
    uint32_t others, sharp;
};

/* Traces a ray up to `limit` m to the nearest surface that chance lets it hit; false: no hit. `chance`: seed of that
 * decision; `tint`: transmittance along the ray, by colour. */
bool meeting_trace(const struct embree_backend *b, struct embree_context *context, struct kiln_vec3 origin,
                   struct kiln_vec3 direction, float limit, uint32_t chance, struct RTCRayHit *ray, float tint[3]);
/* Traces a camera ray, which passes surfaces hidden from the camera (worker/pass/path.h). */
bool meeting_look(const struct embree_backend *b, struct embree_context *context, struct kiln_vec3 origin,
                  struct kiln_vec3 direction, float limit, uint32_t chance, struct RTCRayHit *ray, float tint[3]);
/* Whether the camera sees a world triangle from this side. */
bool meeting_is_seen(const struct embree_backend *b, uint32_t triangle, bool back);

bool meeting_is_back(const struct RTCRayHit *r);
/* Returns the hit record of the triangle that a ray has hit. */
static inline const struct kiln_hit_record *meeting_record(const struct embree_backend *b, const struct RTCRayHit *r)
{
    return &b->params.geometry->records[embree_triangle(b, r->hit.geomID, r->hit.primID)];
}
/* Returns the gloss of a triangle's material; NULL: diffuse. */
const struct kiln_gloss *meeting_gloss(const struct embree_backend *b, const struct kiln_hit_record *record);
/* Whether the triangle has a surface on the side from which a ray comes. */
bool meeting_has_side(const struct embree_backend *b, const struct kiln_hit_record *record, bool back);

/* Returns the surface that a ray has hit. Normals are those of the front, both geometric, until meeting_face. */
struct meeting meeting_make(const struct embree_backend *b, const struct RTCRayHit *r);
/* Prepares scattering towards the origin of a ray of this direction, and turns the normals to that side. `smooth`: the
 * shading normal is needed for diffuse surfaces, too. */
void meeting_face(const struct embree_backend *b, bool smooth, struct kiln_vec3 direction, struct meeting *m);

/* Finds whether rays are lifted off the surface, which meeting_face has turned (shaders/shared/lift.h); glass is not.
 * `smooth`: scattering is about the shading normal, so rays are lifted; else only `coarse` is set. */
void meeting_lift(const struct embree_backend *b, bool smooth, struct meeting *m);
/* Returns the origin of a ray that leaves the surface in a direction. */
static inline struct kiln_vec3 meeting_start(const struct meeting *m, struct kiln_vec3 direction)
{
    const float above = m->offset + m->lift;
    return vec3_madd(m->position, m->normal, m->lifted || vec3_dot(m->normal, direction) > 0.0f ? above : -above);
}

/* meeting_make and meeting_face in two parts, for a surface that is not purely diffuse. The first computes what depends
 * only on the angle (lobes, albedo, o.z), without the diffuse colour; the second computes the rest, if needed. */
struct meeting meeting_begin(const struct embree_backend *b, const struct RTCRayHit *r);
void meeting_end(const struct embree_backend *b, const struct RTCRayHit *r, struct meeting *m);

/* Returns the frame of scattering about a front normal, for a surface that is not purely diffuse. */
struct kiln_frame meeting_frame(const struct embree_backend *b, const struct meeting *m, struct kiln_vec3 normal);
/* Finds the transmittance, by colour, of the body through which the ray has reached its surface from within. False: no
 * body, and `share` is unchanged. `distance`: m. */
bool meeting_attenuation(const struct meeting *m, float distance, float share[3]);

/* Evaluates scattering by `lobes` of a surface that is not purely diffuse: from i, in the frame, to the path's origin,
 * times the cosine. */
struct kiln_bsdf_value meeting_evaluate(const struct meeting *m, struct kiln_vec3 i, uint32_t lobes);
/* Samples a continuation from such a surface among `lobes`, by three random numbers in (0, 1). `weight`: value over
 * density, by colour. `sharp`: share of the sharp lobes in it. False: it carries no light. */
bool meeting_send(const struct meeting *m, uint32_t lobes, float pick, float u, float v, struct kiln_vec3 *direction,
                  float weight[3], float sharp[3]);

#endif
