/* Subpaths of the bidirectional pass: a thread's unfinished camera and light paths. */
#ifndef KILN_WORKER_BACKEND_EMBREE_BIDIRECTIONAL_SUBPATHS_H
#define KILN_WORKER_BACKEND_EMBREE_BIDIRECTIONAL_SUBPATHS_H

#include "worker/backend/embree/bidirectional_vertex.h"
#include "worker/backend/embree/photons.h"
#include "worker/light/emission.h"
#include "worker/pass/bidirectional.h"
#include "worker/sampling/sequence.h"

/* Data that all threads of a call share. They only read it, except the film's sums. */
struct bidirectional {
    const struct embree_backend *b;
    const struct kiln_bidirectional_parameters *parameters;
    const struct kiln_emission *emission;
    uint64_t paths; /* number of light paths in a sample: as many as the picture has pixels */
    double pixel;   /* area of a pixel at distance 1, or m2 when orthographic */
    /* maximum number of diffuse events of a path. All count if it begins at a surface point; else the one at the first
     * surface that light meets does not */
    int64_t most;
    bool from_points;
    uint32_t seed, light_seed;
    /* steps of the method: connects vertices and light samples; merges photons; merges only the pixel's own photons */
    bool connects, merges, own_alone;
    /* state of the current sample */
    double radius, merged_paths;
    struct kiln_path_techniques techniques;
    const struct photon_grid *grid;
};

/* A thread's paths. */
struct subpaths {
    const struct bidirectional *all;
    struct embree_context context;
    uint32_t key, k;      /* key and sample number of random numbers: of a pixel's path, or of a sample's light paths */
    struct vertex *light; /* vertices of the current light path: owned */
    size_t light_count, light_capacity;
    struct photon_list photons;
    double radiance[3]; /* radiance of the current camera path */
    double last[3];     /* from_points: part of the radiance with `most` diffuse events */
    uint64_t rays;
    double seconds; /* processor time, s */
    int status;     /* the first failure */
    struct kiln_error error;
};

/* Draws two random numbers in (0, 1). */
static inline void subpaths_draw(const struct subpaths *w, uint32_t use, double *u, double *v)
{
    uint32_t a, b;
    kiln_path_numbers(kiln_path_key(w->key, use), w->k, &a, &b);
    *u = kiln_unit_double(a);
    *v = kiln_unit_double(b);
}

/* Returns the seed of a ray's random decisions on its way to surface number `surface`. */
static inline uint32_t subpaths_chance(const struct subpaths *w, uint32_t surface)
{
    return kiln_hash2(kiln_path_key(w->key, kiln_path_use(surface, KILN_PATH_CHANCE)), w->k);
}

/* Whether paths with `rays` rays between light and camera are allowed. */
static inline bool subpaths_allow(const struct bidirectional *all, uint32_t rays)
{
    return kiln_path_allows(all->parameters->camera.length, rays);
}

/* Decides by chance whether a subpath continues from surface number `surface` (Russian roulette). `share` is the
 * remaining share of its initial weight; `chain`: surfaces since the last diffuse event. Divides `weight` by the
 * survival probability. */
bool subpaths_survives(const struct subpaths *w, uint32_t surface, uint32_t chain, const float share[3],
                       float weight[3]);

/* Samples the continuation from surface number `surface`, and draws the random numbers for it. */
bool subpaths_leave(const struct subpaths *w, const struct vertex *v, bool of_light, uint32_t lobes, uint32_t surface,
                    struct vertex_way *way);

/* Finds the transmittance, by colour, between two places in the scene. False: nothing gets through. */
bool subpaths_connect(struct subpaths *w, struct kiln_vec3 from, struct kiln_vec3 to, double through[3]);

/* Multiplies the scattering values of two vertices when at most `allowed` diffuse events remain. `a_counts` and
 * `b_counts`: a diffuse event of that vertex counts as one. */
void subpaths_product(const struct vertex_scatter *a, bool a_counts, const struct vertex_scatter *b, bool b_counts,
                      int64_t allowed, double product[3]);

/* View of a place by the camera. subpaths_view finds the pixel; false: the camera does not look there.
 * subpaths_camera_density gives the density of the camera's rays per m2; `cosine` is between the geometric normal and
 * the direction to the camera. With a lens, the density is of the rays from one place on the lens, chosen by two
 * numbers in (0, 1). The plane in focus is parallel to the lens, so the rays from each place are those of a pinhole
 * there, by the angle with the camera's axis. The density of places on the lens is the same in all techniques. */
struct subpath_view {
    struct kiln_vec3 origin, towards; /* origin of a camera ray; unit direction from the place to it */
    float distance;
    uint64_t pixel;
};
bool subpaths_view(const struct bidirectional *all, struct kiln_vec3 place, const double lens[2],
                   struct subpath_view *view);
double subpaths_camera_density(const struct bidirectional *all, const struct subpath_view *view, double cosine);

/* As subpaths_product, but `last` also gets the part of the product that leaves no further diffuse event. */
void subpaths_products(const struct vertex_scatter *a, bool a_counts, const struct vertex_scatter *b, bool b_counts,
                       int64_t allowed, double product[3], double last[3]);

/* Traces light path i of sample k into w->light. */
void subpaths_trace_light(struct subpaths *w, uint64_t i, uint32_t k);
/* Traces the light path with random numbers number k of this key into w->light. */
void subpaths_trace_light_by(struct subpaths *w, uint32_t key, uint32_t k);
/* Traces all light paths of sample k with `all->b->threads` threads, and builds a grid of their vertices: destroy with
 * photon_grid_destroy. `walks`: one for each thread. Not for callers inside parallel regions. */
int subpaths_trace_photons(const struct bidirectional *all, struct subpaths *walks, uint32_t k,
                           struct photon_grid **grid, struct kiln_error *error);
void subpaths_release(struct subpaths *w);
/* Stores the light path's vertices for merging. */
void subpaths_keep_photons(struct subpaths *w, uint64_t i);
/* Connects the light path's vertices to the camera. */
void subpaths_splat(struct subpaths *w);
/* Returns the normal of a vertex for kiln_emission_connect: zero if light may arrive on either side. */
struct kiln_dvec3 subpaths_light_normal(const struct vertex *v);

/* Traces the camera path of a pixel for sample k: sets w->radiance. */
void subpaths_trace_eye(struct subpaths *w, uint64_t pixel, uint32_t k);

/* Continues a path from a surface point at its first ray's hit, on a side with a surface. Sets w->radiance, the
 * radiance along the ray without the emission of that surface, and w->last. `before`: the surface point, of which place
 * and normal are read; `sums`: the sums with which the ray leaves it. The caller has set w->key and w->k. */
void subpaths_follow_eye(struct subpaths *w, const struct vertex *before, const struct kiln_path_sums *sums,
                         const struct RTCRayHit *ray);

#endif
