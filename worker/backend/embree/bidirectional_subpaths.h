/* Shared parts of the bidirectional pass: a thread's paths under way. */
#ifndef KILN_WORKER_BACKEND_EMBREE_BIDIRECTIONAL_SUBPATHS_H
#define KILN_WORKER_BACKEND_EMBREE_BIDIRECTIONAL_SUBPATHS_H

#include "worker/backend/embree/bidirectional_vertex.h"
#include "worker/backend/embree/photons.h"
#include "worker/light/emission.h"
#include "worker/pass/bidirectional.h"
#include "worker/sampling/sequence.h"

/* Data that all threads of a call share: only read while they run, but for the film's sums. */
struct bidirectional {
    const struct embree_backend *b;
    const struct kiln_bidirectional_parameters *parameters;
    const struct kiln_emission *emission;
    uint64_t paths; /* of light in a sample: as many as the picture has pixels */
    double pixel;   /* area of one at distance 1, or m2 when orthographic */
    /* diffuse events of a path, which are all counted where it begins at a surface point; else without the one at the
     * first surface that light meets */
    int64_t most;
    bool from_points;
    uint32_t seed, light_seed;
    /* what the method does: connect a sample of lights and vertices; merge; weigh its techniques */
    bool connects, merges, own_alone;
    /* of the sample under way */
    double radius, merged_paths;
    struct kiln_path_techniques techniques;
    const struct photon_grid *grid;
};

/* A thread's paths. */
struct subpaths {
    const struct bidirectional *all;
    struct embree_context context;
    uint32_t key, k;      /* of random numbers: of a pixel's path, or of a sample's paths of light */
    struct vertex *light; /* the path of light under way: owned */
    size_t light_count, light_capacity;
    struct photon_list photons;
    double radiance[3]; /* of the camera path under way */
    double last[3];     /* from_points: what of that has `most` diffuse events */
    uint64_t rays;
    double seconds; /* of the processor */
    int status;     /* the first failure */
    struct kiln_error error;
};

/* Two numbers in (0, 1). */
static inline void subpaths_draw(const struct subpaths *w, uint32_t use, double *u, double *v)
{
    uint32_t a, b;
    kiln_path_numbers(kiln_path_key(w->key, use), w->k, &a, &b);
    *u = kiln_unit_double(a);
    *v = kiln_unit_double(b);
}

/* Returns the seed for the chance of a ray to surface number `surface`. */
static inline uint32_t subpaths_chance(const struct subpaths *w, uint32_t surface)
{
    return kiln_hash2(kiln_path_key(w->key, kiln_path_use(surface, KILN_PATH_CHANCE)), w->k);
}

/* Whether paths may have so many rays between light and camera. */
static inline bool subpaths_allow(const struct bidirectional *all, uint32_t rays)
{
    return kiln_path_allows(all->parameters->camera.length, rays);
}

/* Chance decides whether a subpath goes on from surface number `surface`, of which the share `weight` of what it began
 * with is left; `chain`: surfaces since the last diffuse event. Divides `weight` by the chance. */
bool subpaths_survives(const struct subpaths *w, uint32_t surface, uint32_t chain, const float share[3],
                       float weight[3]);

/* The way on from surface number `surface`: numbers are drawn here. */
bool subpaths_leave(const struct subpaths *w, const struct vertex *v, bool of_light, uint32_t lobes, uint32_t surface,
                    struct vertex_way *way);

/* Finds the share of light, of each colour, that gets through between two places in the scene. False: nothing. */
bool subpaths_connect(struct subpaths *w, struct kiln_vec3 from, struct kiln_vec3 to, double through[3]);

/* How the values of two vertices come together where their diffuse events may be `allowed` at most: each vertex's
 * `counts` says whether a diffuse event of it is one. */
void subpaths_product(const struct vertex_scatter *a, bool a_counts, const struct vertex_scatter *b, bool b_counts,
                      int64_t allowed, double product[3]);

/* View of a place by the camera. subpaths_view finds the pixel; false: the camera does not look there.
 * subpaths_camera_density gives the density of the camera's rays per m2; its cosine is of the geometric normal, towards
 * the camera. With a lens it is that of the rays from one place on the lens, by two numbers in (0, 1). The plane in
 * focus is parallel to the lens, so the rays from each place are those of a pinhole there, by the angle with the
 * camera's axis. The density of places on the lens is the same in all techniques. */
struct subpath_view {
    struct kiln_vec3 origin, towards; /* of a camera ray; unit, from the place */
    float distance;
    uint64_t pixel;
};
bool subpaths_view(const struct bidirectional *all, struct kiln_vec3 place, const double lens[2],
                   struct subpath_view *view);
double subpaths_camera_density(const struct bidirectional *all, const struct subpath_view *view, double cosine);

/* How light comes on where that is to be told apart: both vertices' values as above, and what of that has no event to
 * spare. */
void subpaths_products(const struct vertex_scatter *a, bool a_counts, const struct vertex_scatter *b, bool b_counts,
                       int64_t allowed, double product[3], double last[3]);

/* Traces path i of light of sample k into w->light. */
void subpaths_trace_light(struct subpaths *w, uint64_t i, uint32_t k);
/* The same of the path whose random numbers are number k of those that hang on the key. */
void subpaths_trace_light_by(struct subpaths *w, uint32_t key, uint32_t k);
/* Traces all paths of light of sample k, by `all->b->threads` threads, and makes a grid of their vertices: destroy with
 * photon_grid_destroy. `walks`: one for each thread. Not for callers inside parallel regions. */
int subpaths_trace_photons(const struct bidirectional *all, struct subpaths *walks, uint32_t k,
                           struct photon_grid **grid, struct kiln_error *error);
void subpaths_release(struct subpaths *w);
/* Keeps its vertices for merging. */
void subpaths_keep_photons(struct subpaths *w, uint64_t i);
/* Connects its vertices to the camera. */
void subpaths_splat(struct subpaths *w);
/* The normal that kiln_emission_connect is given of a vertex: none where light may come from either side. */
struct kiln_dvec3 subpaths_light_normal(const struct vertex *v);

/* Follows sample k's path of a pixel: w->radiance. */
void subpaths_trace_eye(struct subpaths *w, uint64_t pixel, uint32_t k);

/* Follows a path from a surface point on from what its ray has met, on a side of it that is there: w->radiance, what
 * comes along the ray but for what that surface emits, and w->last. `before`: the surface point, of which place and
 * normal are read; `sums`: those with which the ray leaves it. The caller has set w->key and w->k. */
void subpaths_follow_eye(struct subpaths *w, const struct vertex *before, const struct kiln_path_sums *sums,
                         const struct RTCRayHit *ray);

#endif
