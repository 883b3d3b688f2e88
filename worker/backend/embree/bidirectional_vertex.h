/* A vertex of a bidirectional path: what it sends from the light's side to the eye's, and how paths of either end go on
 * from it. All values are by the geometric cosine, so that the adjoint needs no more: with f the value,
 *
 *     a path's light = emission x product of f over vertices x product of |cos| |cos| / squared distance over edges
 *
 * A smooth mesh of whole materials has the frame of its shading normal for a direction that lies on one side of both
 * normals, else that of its geometric one: the eye's direction says which frame the value is of, and each subpath is
 * drawn in that of the direction that it has come from. Diffuse surfaces are about the shading normal where the camera
 * sees them itself, else about the geometric one, as in the path pass.
 *
 * Where a surface scatters about its shading normal, its rays are lifted off coarse facets (meeting_lift), those of
 * both subpaths and of connections alike; only the camera's, which look at it, are not. Light comes from below such a
 * facet then. No ray meets it from there: techniques by which a subpath would have to have no density (landing_o,
 * landing_i), and the others weigh as much more. Thread-safe. */
#ifndef KILN_WORKER_BACKEND_EMBREE_BIDIRECTIONAL_VERTEX_H
#define KILN_WORKER_BACKEND_EMBREE_BIDIRECTIONAL_VERTEX_H

#include "worker/backend/embree/meeting.h"
#include "shaders/shared/bidirectional.h"

struct vertex {
    struct meeting m;               /* normals face the way that the path has come */
    struct kiln_vec3 from;          /* unit, to there */
    struct kiln_vec3 smooth, front; /* normals of the front: of the mesh, geometric */
    float color[3];                 /* of a surface that is only diffuse */
    float opacity;                  /* the chance that it is there */
    bool is_first;                  /* the camera sees it */
    bool is_delta;                  /* mirrors and smooth glass alone: nothing can be connected to it */
    uint32_t mirrors;               /* lobes that are mirrors or smooth glass */
    float weight[3];                /* of the eye's subpath what reaches the camera; of light's the flux, W */
    struct kiln_path_sums sums;
    /* diffuse events that count as bounces before this vertex: the first surface that light meets is none */
    uint32_t bounces;
};

/* Scattering at a vertex that light comes to from i and leaves to the eye at o. */
struct vertex_scatter {
    double all[3], diffuse[3]; /* 1/sr: values; of the diffuse lobe alone, of surfaces that have others */
    double to_light, to_eye;   /* 1/sr: densities of i for the eye's subpath, of o for the light's */
    double cosine_o, cosine_i; /* absolute, of the geometric normal */
    /* the same, for densities of rays that come from there: 0 from below a facet that rays are lifted off, since such
     * rays meet another one */
    double landing_o, landing_i;
};

/* A surface that a ray of this direction has met (meeting_face, meeting_end), as an inner vertex, taken to be there.
 * Weight, sums and bounces are left to the caller. */
struct vertex vertex_of(const struct embree_backend *b, const struct meeting *m, struct kiln_vec3 direction);
/* Makes a vertex of what a ray has hit, seen by the camera or not. Weight, sums and bounces are left to the caller. */
struct vertex vertex_make(const struct embree_backend *b, const struct RTCRayHit *ray, bool is_first);
/* The same vertex, of a subpath of light, as the camera would see it. */
struct vertex vertex_as_first(const struct embree_backend *b, const struct vertex *v);

/* Scattering by `lobes`. False: nothing is sent. Both directions are unit and point away. */
bool vertex_scatter(const struct embree_backend *b, const struct vertex *v, struct kiln_vec3 o, struct kiln_vec3 i,
                    uint32_t lobes, struct vertex_scatter *s);

/* The way on. */
struct vertex_way {
    struct kiln_vec3 direction;
    float factor[3]; /* f x cosine / density */
    double forward, backward, cosine;
    double landing;      /* the cosine for the density of a ray that comes back: as of struct vertex_scatter */
    bool delta, diffuse; /* by a mirror or smooth glass; as a diffuse event */
};

/* Draws the way on, of the eye's subpath or of light's, by numbers in (0, 1); `rest` decides whether it counts as a
 * diffuse event, which is exact in the mean where the vertex has other lobes too. False: it brings nothing. */
bool vertex_leave(const struct embree_backend *b, const struct vertex *v, bool of_light, uint32_t lobes,
                  const double numbers[4], struct vertex_way *way);

/* Whether all lobes of a vertex that are not diffuse are mirrors or smooth glass: no sample of a light finds anything
 * by them. */
bool vertex_is_smooth(const struct vertex *v);

/* Where a ray starts that leaves the vertex in a direction. */
static inline struct kiln_vec3 vertex_start(const struct vertex *v, struct kiln_vec3 direction)
{
    return meeting_start(&v->m, direction);
}

/* Multiplies by what is left of light that leaves the vertex towards the eye's side, over a distance in m, in a body of
 * glass that the vertex bounds; elsewhere by nothing. */
void vertex_attenuate(const struct vertex *v, struct kiln_vec3 direction, float distance, float light[3]);

#endif
