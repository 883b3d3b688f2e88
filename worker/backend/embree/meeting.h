/* A surface that a path of light meets, on the side that it comes from: where it is, which way it faces, and how it
 * scatters light. Shared by the passes that follow paths ray by ray. Thread-safe. */
#ifndef KILN_WORKER_BACKEND_EMBREE_MEETING_H
#define KILN_WORKER_BACKEND_EMBREE_MEETING_H

#include "shaders/shared/path.h"
#include "worker/backend/embree/passage.h"
#include "worker/material/surface_bsdf.h"

/* A surface that a path meets, on the side that it comes from. */
struct meeting {
    uint32_t triangle, stored;
    const struct kiln_mesh *mesh;
    float u, v, b1, b2; /* weights of the world triangle's corners, and of the stored one's */
    bool back;
    struct kiln_vec3 position, normal, shading; /* normals: geometric and of the mesh */
    float offset;                               /* m along the normal from which rays start */
    /* meeting_lift: its triangle is a coarse facet of a smooth mesh; rays start `lift` m above the offset besides, and
     * light counts that the shading normal faces, be it from below the facet */
    bool coarse, lifted;
    float lift;
    /* what more there is of a surface that is not only diffuse; NULL: nothing */
    const struct kiln_gloss *gloss;
    struct kiln_frame frame; /* of its front */
    struct kiln_bsdf_lobes lobes;
    struct kiln_vec3 o;             /* where the path comes from, in the frame */
    struct kiln_bsdf_albedo albedo; /* of its lobes, for o */
    struct kiln_bsdf_choice shares; /* by luminance */
    /* its lobes that are not diffuse, and of these those whose light is what the path's rays meet */
    uint32_t others, sharp;
};

/* Traces a ray up to `limit` m to the nearest surface that chance takes for there; false: it meets none. `chance`: what
 * that hangs on; `tint`: what arrives of each colour. */
bool meeting_trace(const struct embree_backend *b, struct embree_context *context, struct kiln_vec3 origin,
                   struct kiln_vec3 direction, float limit, uint32_t chance, struct RTCRayHit *ray, float tint[3]);
/* The same for a ray of the camera, which goes on behind what the camera does not see (worker/pass/path.h). */
bool meeting_look(const struct embree_backend *b, struct embree_context *context, struct kiln_vec3 origin,
                  struct kiln_vec3 direction, float limit, uint32_t chance, struct RTCRayHit *ray, float tint[3]);
/* Whether the camera sees a world triangle from this side. */
bool meeting_is_seen(const struct embree_backend *b, uint32_t triangle, bool back);

bool meeting_is_back(const struct RTCRayHit *r);
/* The record of what a ray has hit. */
static inline const struct kiln_hit_record *meeting_record(const struct embree_backend *b, const struct RTCRayHit *r)
{
    return &b->params.geometry->records[embree_triangle(b, r->hit.geomID, r->hit.primID)];
}
/* The gloss that the material of a triangle is taken with; NULL: it is diffuse. */
const struct kiln_gloss *meeting_gloss(const struct embree_backend *b, const struct kiln_hit_record *record);
/* Whether a ray that comes from this side finds the surface there. */
bool meeting_has_side(const struct embree_backend *b, const struct kiln_hit_record *record, bool back);

/* Returns the surface that a ray has hit. Normals are those of the front, both geometric, until meeting_face. */
struct meeting meeting_make(const struct embree_backend *b, const struct RTCRayHit *r);
/* Finds how the surface scatters light to where a ray of this direction comes from, and turns the normals to that side.
 * `smooth`: the shading normal is wanted of diffuse surfaces too. */
void meeting_face(const struct embree_backend *b, bool smooth, struct kiln_vec3 direction, struct meeting *m);

/* Finds whether rays are lifted off the surface, which meeting_face has turned (shaders/shared/lift.h): not off glass.
 * `smooth`: it scatters light about its shading normal, so that they are; else only `coarse` is set. */
void meeting_lift(const struct embree_backend *b, bool smooth, struct meeting *m);
/* Where a ray starts that leaves the surface in a direction. */
static inline struct kiln_vec3 meeting_start(const struct meeting *m, struct kiln_vec3 direction)
{
    const float above = m->offset + m->lift;
    return vec3_madd(m->position, m->normal, m->lifted || vec3_dot(m->normal, direction) > 0.0f ? above : -above);
}

/* The same in two parts, of a surface that is not only diffuse: what hangs on no more than the angle (lobes, albedo,
 * o.z), without the colour of the diffuse part; then, where it is wanted, all the rest. */
struct meeting meeting_begin(const struct embree_backend *b, const struct RTCRayHit *r);
void meeting_end(const struct embree_backend *b, const struct RTCRayHit *r, struct meeting *m);

/* The frame of the scattering about a normal of the front, for a surface that is not only diffuse. */
struct kiln_frame meeting_frame(const struct embree_backend *b, const struct meeting *m, struct kiln_vec3 normal);
/* Finds the share of light, by colour, that the body leaves that the ray has come through to its surface from within.
 * False: there is none, and `share` is left as it is. `distance`: m. */
bool meeting_attenuation(const struct meeting *m, float distance, float share[3]);

/* Returns the scattering by `lobes` of a surface that is not only diffuse, of light from i, in the frame, to where the
 * path comes from, times the cosine. */
struct kiln_bsdf_value meeting_evaluate(const struct meeting *m, struct kiln_vec3 i, uint32_t lobes);
/* Draws the way on from such a surface among `lobes`, by three random numbers in (0, 1). `weight`: value over density,
 * by colour. `sharp`: share of its sharp lobes in it. False: the way brings nothing. */
bool meeting_send(const struct meeting *m, uint32_t lobes, float pick, float u, float v, struct kiln_vec3 *direction,
                  float weight[3], float sharp[3]);

#endif
