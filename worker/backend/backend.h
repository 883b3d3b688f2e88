/* What a backend is: one struct of functions. The bounce loop knows no Embree and no Vulkan; a backend knows no MPI.
 *
 * A backend holds the scene, the surface and the radiosity of all surface points, and traces batches: ranges of this
 * rank's own tile runs. The neutral functions below (kiln_backend_*) check their arguments once and call the backend.
 *
 * Estimators (DESIGN section 3), for a point x with geometric normal n and shading normal s, whose samples lie at
 * positions uniform over the covered, unburied part of its texel (of one that is partly there, by its opacity): direct
 * E = sum over lights of the mean of L V cos / p gather   E = mean over cosine-distributed directions about n of
 * B(hit); the lightmap's value, about the shading normal, is the same mean weighted by max(0, s.w) / (n.w) (drawn about
 * the axis between both, see the backend) Rays that meet the back of a double-sided surface find the radiosity of the
 * back's own points. Rays that meet the back of a single-sided surface, or of a solid's (worker/scene/solids.h), bring
 * nothing and count as blocked; rays that meet nothing as escaped, with what tinted glass took of them on the way.
 * Surfaces that let light through (struct kiln_passage): a shadow ray brings the product of what they let through; a
 * gather ray meets one with a chance that is its opacity, and is tinted by those that it passes; a point's samples lie
 * where its surface is there.
 *
 * Determinism: results are functions of (seed, object, texel, stream, sample) and the scene alone: any batch, thread
 * count or rank gives the same bits. */
#ifndef KILN_WORKER_BACKEND_BACKEND_H
#define KILN_WORKER_BACKEND_BACKEND_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "shaders/shared/streams.h"
#include "worker/base/stop.h"
#include "worker/scene/scene.h"
#include "worker/scene/geometry.h"
#include "worker/scene/surface.h"

struct kiln_lights;

/* How a device finds hits: by walking a BVH in compute shaders, or by its own ray-tracing pipeline. AUTO: what is
 * fastest here, COMPUTE: the fastest BVH. The rest name one, for measuring. */
enum kiln_traversal {
    KILN_TRAVERSE_AUTO,
    KILN_TRAVERSE_COMPUTE,
    KILN_TRAVERSE_PIPELINE,
    KILN_TRAVERSE_ALL, /* no tree: every triangle is tested */
    KILN_TRAVERSE_BINARY,
    KILN_TRAVERSE_FOUR,
    KILN_TRAVERSE_EIGHT
};

/* Zero means default in every field. Borrowed pointers must outlive the backend. */
struct kiln_backend_params {
    const struct kiln_scene *scene;
    const struct kiln_geometry *geometry;
    const struct kiln_lights *lights;
    uint32_t threads;            /* 0: all of the machine's cores that this process may use */
    const char *instruction_set; /* Embree's name ("avx2", ...); NULL: the best there is */
    uint64_t seed;
    /* devices */
    uint32_t device;                  /* 1 + the number that `kiln info --devices` shows; 0: by local_rank */
    uint32_t local_rank, local_ranks; /* among the ranks of this node */
    enum kiln_traversal traversal;
    double slice_seconds;   /* what one dispatch may take; 0: 0.1 */
    uint64_t device_memory; /* bytes; 0: what the device has */
    bool goes_on;           /* with Embree once the device has failed for good (worker/backend/fallback.h) */
    double verify_share;    /* of the tile runs, traced again with Embree (worker/backend/verify.h); 0: none */
    /* ends creation, emission and validity early, with KILN_STOPPED; NULL: nothing does */
    const struct kiln_stop *stop;
};

/* Three floats a point; see kiln_radiosity_pack for how radiosity is kept. */
struct kiln_point_result {
    float irradiance[3]; /* about the shading normal, W/m2: the lightmap's quantity */
    float incident[3];   /* about the geometric normal, W/m2: what is absorbed or reflected */
    /* standard error of the luminance of `irradiance` (an upper estimate: from the spread of 4 sub-nets) */
    float error;
    float escaped; /* share of gather rays that met nothing (0 in the direct pass) */
    float blocked; /* share of gather rays that met the back of a single-sided surface (0 in the direct pass) */
    /* by colour: share of what gather rays find that tinted surfaces on the way take; 0 without any */
    float glass[3];
    /* mean opacity of the point (kiln_surface_opacity): share of its area that is there to be lit; 1 for opaque ones */
    float present;
};

/* What is done with answers: called on the calling thread for consecutive parts of a batch, in order, while a device
 * may already be busy with the next. `results` has one entry for each point of the tile runs, in order, and is only
 * lent. A status other than KILN_OK ends the pass with it. */
typedef int (*kiln_take_results)(void *context, size_t tile_run_first, size_t tile_run_count,
                                 const struct kiln_point_result *results, struct kiln_error *error);

/* A range of own tile runs. Any length: the backend cuts it up as suits its device. `take` NULL: answers are dropped.
 */
struct kiln_batch {
    size_t tile_run_first, tile_run_count;
    kiln_take_results take;
    void *context;
};

struct kiln_hit {
    uint32_t triangle; /* world triangle, KILN_NONE: nothing */
    float u, v;
    float distance;
    bool back; /* met from behind */
    /* by colour: share of what comes from there that the surfaces before it let through; 1 without tinted ones */
    float tint[3];
};

/* Seed of a ray's chances with surfaces that are partly there: the same ray always decides alike. */
static inline uint32_t kiln_ray_seed(struct kiln_vec3 origin, struct kiln_vec3 direction)
{
    uint32_t o[3], d[3];
    memcpy(o, &origin, sizeof o);
    memcpy(d, &direction, sizeof d);
    return kiln_ray_bits_seed(o[0], o[1], o[2], d[0], d[1], d[2]);
}

/* One probe's answer: SH coefficients of incident radiance, bands 0..2, order (l,m) = 00, 1-1, 10, 11, 2-2, 2-1, 20,
 * 21, 22, real orthonormal basis as in Ramamoorthi and Hanrahan 2001, RGB for each. */
struct kiln_probe_result {
    float radiance[9][3];
    float irradiance_axes[6][3]; /* irradiance on faces looking along +x -x +y -y +z -z, estimated directly */
    /* m, harmonic-free plain mean of hit distances; the scene's diagonal stands in for escapes */
    float mean_distance;
    float back_share; /* share of rays that met a back face: near 1 inside geometry */
};

/* Where light that leaves the lights goes: traced from the lights, independent of the direct pass. Watts, RGB. */
struct kiln_emission_result {
    double emitted[3], received[3], blocked[3], escaped[3]; /* blocked: on backs of single-sided surfaces */
    double ranged[3];                                       /* cut off by a light's range */
    double glass[3];                                        /* taken by tinted surfaces that it went through */
    double error[3];                                        /* standard error of `received` */
};

struct kiln_backend_info {
    char name[32];    /* "embree" */
    char device[128]; /* "Embree 3.13.5, avx2, 2 threads" */
    size_t memory;    /* bytes held by the backend itself (its BVH and copies) */
    double build_seconds;
    double device_seconds; /* that a device was busy with kernels and copies so far; 0: it has no clock of its own */
    /* that threads computed direct light and gathers so far, waiting for each other not counted: the sum over threads;
     * 0: a device does that */
    double thread_seconds;
    uint32_t take_threads; /* more than these are not worth having to take answers over; 0: any number is */
    /* kiln_backend_set_surface costs nothing: it can compute a part of another rank's share between its own. A device
     * that keeps its points cannot: the ranks of its node neither give work away nor take any */
    bool any_share;
    uint64_t part_points; /* a batch's answers are handed over in parts of about so many; 0: it depends */
    uint32_t recoveries;  /* how often it was lost or short of memory, and made anew */
    /* it failed for good and Embree went on: name, device, memory and build_seconds are Embree's */
    bool fell_back;
    uint64_t verified; /* texels traced again with Embree so far, once for each pass (worker/backend/verify.h) */
    uint64_t beyond;   /* of these, how many were apart by more than rounding and noise explain; a few may be */
    double worst;      /* the largest difference of one, over what rounding and noise explain */
};

struct kiln_backend;

struct kiln_backend_api {
    const char *name;
    int (*create)(struct kiln_backend **backend, const struct kiln_backend_params *params, struct kiln_error *error);
    void (*destroy)(struct kiln_backend **backend);
    void (*info)(const struct kiln_backend *backend, struct kiln_backend_info *info);
    int (*set_surface)(struct kiln_backend *backend, const struct kiln_surface *surface, struct kiln_error *error);
    int (*set_radiosity)(struct kiln_backend *backend, const uint64_t *radiosity, struct kiln_error *error);
    int (*validity)(struct kiln_backend *backend, size_t tile_run_first, size_t tile_run_count, uint16_t *visible,
                    struct kiln_error *error);
    int (*direct)(struct kiln_backend *backend, const struct kiln_batch *batch, uint32_t samples, uint64_t *rays,
                  struct kiln_error *error);
    int (*gather)(struct kiln_backend *backend, const struct kiln_batch *batch, uint32_t samples, uint32_t stream,
                  uint64_t *rays, struct kiln_error *error);
    int (*probes)(struct kiln_backend *backend, const struct kiln_vec3 *positions, size_t count, uint64_t index_first,
                  uint32_t samples, struct kiln_probe_result *results, uint64_t *rays, struct kiln_error *error);
    int (*intersect)(struct kiln_backend *backend, const struct kiln_vec3 *origins, const struct kiln_vec3 *directions,
                     size_t count, struct kiln_hit *hits, struct kiln_error *error);
    int (*ceiling)(struct kiln_backend *backend, const struct kiln_batch *batch, uint32_t samples, uint32_t stream,
                   double *seconds, uint64_t *rays, struct kiln_error *error);
};

/* The first member of each backend's own struct. */
struct kiln_backend {
    const struct kiln_backend_api *api;
    struct kiln_backend_params params; /* as kiln_backend_create filled them in */
};

extern const struct kiln_backend_api kiln_backend_embree;
extern const struct kiln_backend_api kiln_backend_vulkan;

/* None of these is collective. A backend is used by one thread at a time and runs its own threads inside a call. */

/* Creates the backend called `name`: "embree", "vulkan", or "auto", which takes Vulkan where there is a fit device that
 * is not software and starts, else Embree. KILN_NO_DEVICE when there is none of that name here. */
int kiln_backend_create(struct kiln_backend **backend, const char *name, const struct kiln_backend_params *params,
                        struct kiln_error *error);
void kiln_backend_destroy(struct kiln_backend **backend);

/* Hands over the surface (borrowed). Must come before validity, direct and gather. */
int kiln_backend_set_surface(struct kiln_backend *backend, const struct kiln_surface *surface,
                             struct kiln_error *error);
/* Hands over the radiosity of all points, packed, surface->point_count values (borrowed until the next call). */
int kiln_backend_set_radiosity(struct kiln_backend *backend, const uint64_t *radiosity, struct kiln_error *error);
/* For each own point of the range writes the share of it that is not buried (see surface->visible) into the array
 * given, a whole array of the share. A place is buried when rays along its normal and around it all meet back faces of
 * single-sided surfaces. */
int kiln_backend_validity(struct kiln_backend *backend, size_t tile_run_first, size_t tile_run_count, uint16_t *visible,
                          struct kiln_error *error);
int kiln_backend_direct(struct kiln_backend *backend, const struct kiln_batch *batch, uint32_t samples, uint64_t *rays,
                        struct kiln_error *error);
/* `stream` tells the bounces apart in the random numbers: 1, 2, ... for bounces, 0xffff for the final gather. */
int kiln_backend_gather(struct kiln_backend *backend, const struct kiln_batch *batch, uint32_t samples, uint32_t stream,
                        uint64_t *rays, struct kiln_error *error);
/* `positions` are relative to the scene's centre; `index_first` is the first one's index among all probes. */
int kiln_backend_probes(struct kiln_backend *backend, const struct kiln_vec3 *positions, size_t count,
                        uint64_t index_first, uint32_t samples, struct kiln_probe_result *results, uint64_t *rays,
                        struct kiln_error *error);
/* Traces about `samples` particles from the lights: made on the host, in batches, in the same way for every backend
 * (emission.c). */
int kiln_backend_emission(struct kiln_backend *backend, uint32_t samples, struct kiln_emission_result *result,
                          struct kiln_error *error);
/* Closest hits of any rays (origins relative to the centre, directions of unit length): views, checks and benches. */
int kiln_backend_intersect(struct kiln_backend *backend, const struct kiln_vec3 *origins,
                           const struct kiln_vec3 *directions, size_t count, struct kiln_hit *hits,
                           struct kiln_error *error);
/* For benches: the gather pass's own rays over a batch, in the same packets and order, traced by the tracer alone; adds
 * the seconds that its calls took and the number of rays. One thread. Results are not written. */
int kiln_backend_ceiling(struct kiln_backend *backend, const struct kiln_batch *batch, uint32_t samples,
                         uint32_t stream, double *seconds, uint64_t *rays, struct kiln_error *error);
/* One line: Embree's version as it is installed. */
void kiln_backend_embree_version(char *text, size_t size);
static inline void kiln_backend_info(const struct kiln_backend *backend, struct kiln_backend_info *info)
{
    backend->api->info(backend, info);
}

#endif
