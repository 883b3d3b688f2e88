/* A vertex of a bidirectional path: its scattering from the light's side to the eye's, and sampling of continuations
 * for both kinds of subpaths. All values refer to the geometric cosine, so that the adjoint needs no correction: with f
 * the value,
 *
 *     a path's light = emission x product of f over vertices x product of |cos| |cos| / squared distance over edges
 *
 * On a smooth mesh with simulated gloss, the frame is about the shading normal for a direction on the same side of both
 * normals, else about the geometric normal. The eye's direction selects the frame of the value; each subpath is sampled
 * in the frame of its incoming direction. Diffuse surfaces use the shading normal where the camera sees them directly,
 * else the geometric one, as in the path pass.
 *
 * Where a surface scatters about its shading normal, its rays are lifted off coarse facets (meeting_lift), in both
 * subpaths and in connections, but not for camera rays, which look at the facet itself. Light can then arrive from
 * below such a facet, where no traced ray can hit it. Techniques that would need such a hit have density 0 (landing_o,
 * landing_i), and the others get their weight. Thread-safe. */
#ifndef KILN_WORKER_BACKEND_EMBREE_BIDIRECTIONAL_VERTEX_H
#define KILN_WORKER_BACKEND_EMBREE_BIDIRECTIONAL_VERTEX_H

#include "worker/backend/embree/meeting.h"
#include "shaders/shared/bidirectional.h"

struct vertex {
    struct meeting m;               /* normals face the side that the path comes from */
    struct kiln_vec3 from;          /* unit, to there */
    struct kiln_vec3 smooth, front; /* front normals: of the mesh, and geometric */
    float color[3];                 /* colour of a purely diffuse surface */
    float opacity;                  /* probability that a ray hits it */
    bool is_first;                  /* the camera sees it */
    bool is_delta;                  /* only mirrors and smooth glass: nothing can be connected to it */
    uint32_t mirrors;               /* lobes that are mirrors or smooth glass */
    float weight[3];                /* eye subpath: share that reaches the camera; light subpath: flux, W */
    struct kiln_path_sums sums;
    /* number of diffuse events before this vertex that count as bounces: the first surface that light meets does not
     * count */
    uint32_t bounces;
};

/* Scattering at a vertex that light comes to from i and leaves to the eye at o. */
struct vertex_scatter {
    double all[3], diffuse[3]; /* 1/sr: values of all lobes; of the diffuse lobe alone, if there are others */
    double to_light, to_eye;   /* 1/sr: density of i for the eye's subpath, and of o for the light's */
    double cosine_o, cosine_i; /* absolute, of the geometric normal */
    /* cosines for the densities of rays that arrive from o and i. 0 from below a facet that rays are lifted off, since
     * such rays hit another facet */
    double landing_o, landing_i;
};

/* Makes an inner vertex of a surface that a ray of this direction has hit (meeting_face, meeting_end), taken to be
 * present. Weight, sums and bounces are left to the caller. */
struct vertex vertex_of(const struct embree_backend *b, const struct meeting *m, struct kiln_vec3 direction);
/* Makes a vertex of what a ray has hit, seen by the camera or not. Weight, sums and bounces are left to the caller. */
struct vertex vertex_make(const struct embree_backend *b, const struct RTCRayHit *ray, bool is_first);
/* Converts a vertex of a light subpath to one that the camera sees directly. */
struct vertex vertex_as_first(const struct embree_backend *b, const struct vertex *v);

/* Evaluates scattering by `lobes`. False: no light is scattered. Both directions are unit and point away. */
bool vertex_scatter(const struct embree_backend *b, const struct vertex *v, struct kiln_vec3 o, struct kiln_vec3 i,
                    uint32_t lobes, struct vertex_scatter *s);

/* Sampled continuation of a subpath. */
struct vertex_way {
    struct kiln_vec3 direction;
    float factor[3]; /* f x cosine / density */
    double forward, backward, cosine;
    double landing;      /* cosine for the density of a returning ray: as in struct vertex_scatter */
    bool delta, diffuse; /* by a mirror or smooth glass; as a diffuse event */
};

/* Samples the continuation of an eye or light subpath by numbers in (0, 1). `rest` decides whether it counts as a
 * diffuse event, which is unbiased if the vertex has other lobes too. False: it carries no light. */
bool vertex_leave(const struct embree_backend *b, const struct vertex *v, bool of_light, uint32_t lobes,
                  const double numbers[4], struct vertex_way *way);

/* Whether all non-diffuse lobes of a vertex are mirrors or smooth glass, by which light samples find nothing. */
bool vertex_is_smooth(const struct vertex *v);

/* Returns the origin of a ray that leaves the vertex in a direction. */
static inline struct kiln_vec3 vertex_start(const struct vertex *v, struct kiln_vec3 direction)
{
    return meeting_start(&v->m, direction);
}

/* Attenuates light that leaves the vertex towards the eye's side over a distance in m, if it travels in a glass body
 * that the vertex bounds. */
void vertex_attenuate(const struct vertex *v, struct kiln_vec3 direction, float distance, float light[3]);

#endif
