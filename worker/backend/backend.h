/* A backend: what traces rays, on the CPU (embree/) or on a GPU (vulkan/). One struct of functions.
 *
 * A backend holds the scene, the surface and the radiosity of all surface points, and runs passes (worker/pass/pass.h)
 * over batches of items. What passes there are, what they take and give, their formulas and units stand in worker/pass;
 * neither this header nor the neutral layer behind it (backend.c, fallback.c, verify.c) knows a pass by name. The
 * functions below (kiln_backend_*) check their arguments once and call the backend. A backend knows no MPI. */
#ifndef KILN_WORKER_BACKEND_BACKEND_H
#define KILN_WORKER_BACKEND_BACKEND_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "shaders/shared/streams.h"
#include "worker/base/clock.h"
#include "worker/base/device.h"
#include "worker/base/kernel_store.h"
#include "worker/base/stop.h"
#include "worker/pass/held.h"
#include "worker/pass/pass.h"
#include "worker/pass/regression.h"
#include "worker/scene/scene.h"
#include "worker/scene/geometry.h"
#include "worker/scene/radiance_probes.h"
#include "worker/scene/surface.h"

struct kiln_lights;
struct kiln_rows;
struct kiln_groups;
struct kiln_sphere;
struct kiln_backend_start;

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
    const struct kiln_lights *direct_lights; /* which the direct pass samples, some of `lights`; NULL: all */
    uint32_t threads;                        /* 0: all of the machine's cores that this process may use */
    const char *instruction_set;             /* Embree's name ("avx2", ...); NULL: the best there is */
    uint64_t seed;
    /* devices */
    uint32_t device;                  /* 1 + the number that `kiln info --devices` shows; 0: by local_rank */
    uint32_t local_rank, local_ranks; /* among the ranks of this node */
    enum kiln_traversal traversal;
    double rays;            /* expected in all passes; where they are few, no traversal is tried. 0: not known */
    double slice_seconds;   /* what one dispatch may take; 0: 0.1 */
    uint64_t device_memory; /* bytes; 0: what the device has */
    /* surfaces of a chain that are met for certain (shaders/shared/chain.h); 0: KILN_CHAIN_LENGTH */
    uint32_t chain_length;
    bool goes_on;           /* with Embree once the device has failed for good (worker/backend/fallback.h) */
    double verify_fraction; /* of the tile runs, traced again with Embree (worker/backend/verify.h); 0: none */
    /* ends creation, emission and validity early, with KILN_STOPPED; NULL: nothing does */
    const struct kiln_stop *stop;
    struct kiln_kernel_store kernels; /* where a device's compiled kernels are kept */
    /* Passes that will run over the surface: bit KILN_PASS_INDEX_... A device's kernels for them are made beside what
     * comes before. 0: none is known of */
    uint32_t passes;
    bool regresses;                   /* likewise: kiln_backend_regress will be called */
    struct kiln_backend_start *start; /* of a device, which creation goes on with (start.h); NULL: none has begun */
    struct kiln_device_faults faults; /* for tests */
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

/* Where light that leaves the lights goes: traced from the lights, independent of the direct pass. Watts, RGB. */
struct kiln_emission_result {
    double emitted[3], received[3], blocked[3], escaped[3]; /* blocked: on backs of single-sided surfaces */
    double ranged[3];                                       /* cut off by a light's range */
    double glass[3];                                        /* taken by tinted surfaces that it went through */
    double gloss[3];   /* taken by mirrors, gloss and bodies of glass that it went by way of; 0 without any */
    double caustic[3]; /* part of `received` that came by way of these */
    /* part of `caustic` that gather rays cannot find: a mirror or smooth glass was first, and the light has no size */
    double mirrored[3];
    double error[3]; /* standard error of `received`, and of its parts: what came straight, and `caustic` */
    double straight_error[3], caustic_error[3];
};

enum { KILN_KERNELS_MOST = 32 };

struct kiln_backend_info {
    char name[32];    /* "embree" */
    char device[128]; /* "Embree 3.13.5, avx2, 2 threads" */
    size_t memory;    /* bytes held by the backend itself (its BVH and copies) */
    double build_seconds;
    double device_seconds; /* that a device was busy with kernels and copies so far; 0: it has no clock of its own */
    /* s, and s of the processor, that callers have waited so far for what is made or brought once: kernels, and what
     * stays on a device for kiln_backend_hold */
    double once_seconds, once_processor;
    uint64_t returned; /* bytes of answers of passes over points that it has handed to the host so far */
    /* processor time of the direct and gather passes so far, summed over threads, without waiting for each other; 0: a
     * device does the work */
    double thread_seconds;
    uint32_t take_threads;    /* more than these are not worth having to take answers over; 0: any number is */
    bool computes_for_others; /* it runs stealable passes (worker/pass/pass.h) over tile runs of other ranks */
    bool keeps_points;        /* a device, on which points stay once they are there */
    double point_seconds;     /* that bringing a point there takes, as far as is known; 0: nothing */
    bool regresses;           /* kiln_backend_regress is quicker than the host's own way */
    uint32_t mixed, claims;   /* passes that it takes with any numbers of samples at once; and those whose batches it
                                 claims part by part: kiln_backend_claims */
    uint64_t part_points;     /* a batch's results are taken in parts of about so many points; 0: it depends */
    uint32_t recoveries;      /* how often it was lost or short of memory, and made anew */
    /* it failed for good and Embree went on: name, device, memory and build_seconds are Embree's */
    bool fell_back;
    /* names of what has computed so far: the passes of the Embree backend, the kernels of the Vulkan backend */
    const char *kernels[KILN_KERNELS_MOST];
    size_t kernel_count;
    /* a device's kernels that were kept from an earlier run, and those that its driver had to compile */
    uint64_t kernels_found, kernels_made;
    struct kiln_aside starting, making; /* a device, and kernels of it: beside what else was done to begin */
    uint64_t verified; /* texels traced again with Embree so far, once for each pass (worker/backend/verify.h) */
    uint64_t beyond;   /* of these, how many were apart by more than rounding and noise explain; a few may be */
    double worst;      /* the largest difference of one, over what rounding and noise explain */
};

/* Tile runs of another rank: some of its surface, which has the same map. Zero: none. */
struct kiln_others {
    const struct kiln_surface *surface; /* borrowed; NULL: none */
    size_t first, count;                /* its tile runs */
};

struct kiln_backend;

struct kiln_backend_api {
    const char *name;
    /* What of creation needs no scene, geometry, lights; `create` then goes on with *backend. NULL: there is nothing */
    int (*begin)(struct kiln_backend **backend, const struct kiln_backend_params *params, struct kiln_error *error);
    int (*create)(struct kiln_backend **backend, const struct kiln_backend_params *params, struct kiln_error *error);
    void (*destroy)(struct kiln_backend **backend);
    int (*devices)(struct kiln_device *list, size_t room, size_t *count, struct kiln_error *error);
    void (*info)(const struct kiln_backend *backend, struct kiln_backend_info *info);
    int (*set_surface)(struct kiln_backend *backend, const struct kiln_surface *surface, struct kiln_error *error);
    int (*set_others)(struct kiln_backend *backend, const struct kiln_others *others,
                      struct kiln_error *error); /* NULL: set_surface does it */
    int (*set_radiosity)(struct kiln_backend *backend, const uint64_t *radiosity, struct kiln_error *error);
    int (*set_probes)(struct kiln_backend *backend, const struct kiln_radiance_probes *probes,
                      struct kiln_error *error);
    /* Passes that `run` takes with any numbers in samples_each: bit KILN_PASS_INDEX_...; `samples` is the largest then.
     * For other passes over tile runs each number is `samples` or 0, for those over positions samples_each is NULL. */
    uint32_t mixed;
    uint32_t claims; /* likewise passes whose batches `run` claims part by part; it claims others as a whole */
    bool (*takes)(const struct kiln_backend *backend, const struct kiln_pass *pass,
                  const void *parameters); /* NULL: any */
    void (*expect)(struct kiln_backend *backend, const struct kiln_pass *pass,
                   const void *parameters); /* NULL: nothing is to be done */
    /* The arguments of kiln_backend_run, checked; at least one item */
    int (*run)(struct kiln_backend *backend, const struct kiln_pass *pass, const void *parameters,
               const struct kiln_batch *batch, uint64_t *rays, struct kiln_error *error);
    int (*intersect)(struct kiln_backend *backend, const struct kiln_vec3 *origins, const struct kiln_vec3 *directions,
                     size_t count, struct kiln_hit *hits, struct kiln_error *error);
    /* NULL: nothing is known, 0 */
    int (*clearance)(struct kiln_backend *backend, const struct kiln_sphere *spheres, size_t count, float *clear,
                     struct kiln_error *error);
    /* NULL: `intersect` does it */
    int (*intersect_within)(struct kiln_backend *backend, const struct kiln_vec3 *origins,
                            const struct kiln_vec3 *directions, const float *lengths, size_t count,
                            struct kiln_hit *hits, struct kiln_error *error);
    /* NULL: `intersect` does it */
    int (*intersect_alike)(struct kiln_backend *backend, const struct kiln_vec3 *origins,
                           const struct kiln_vec3 *directions, size_t count, struct kiln_hit *hits,
                           struct kiln_error *error);
    int (*ceiling)(struct kiln_backend *backend, const struct kiln_batch *batch, double *seconds, uint64_t *rays,
                   struct kiln_error *error);
    int (*change_light)(struct kiln_backend *backend, struct kiln_error *error); /* NULL: there is nothing to do */
    /* NULL: the caller does it */
    int (*replay)(struct kiln_backend *backend, struct kiln_rows *rows, const uint64_t *const *lights, size_t count,
                  const struct kiln_batch *batch, struct kiln_error *error);
    /* NULL: light does not stay here */
    int (*hold)(struct kiln_backend *backend, const struct kiln_held *begin, bool *held, struct kiln_held_power *powers,
                struct kiln_error *error);
    int (*hold_step)(struct kiln_backend *backend, struct kiln_rows *rows, const struct kiln_batch *batch,
                     const struct kiln_held_step *step, struct kiln_held_power *powers, struct kiln_error *error);
    int (*hold_fetch)(struct kiln_backend *backend, uint32_t light, const struct kiln_held_fetch *to,
                      struct kiln_error *error);
    /* NULL: the caller does it */
    int (*regress)(struct kiln_backend *backend, const struct kiln_regression_work *work, bool *done,
                   struct kiln_error *error);
};

/* The first member of each backend's own struct. */
struct kiln_backend {
    const struct kiln_backend_api *api;
    struct kiln_backend_params params;  /* as kiln_backend_create filled them in */
    const struct kiln_surface *surface; /* that passes run over; NULL: none yet */
    struct kiln_others others;          /* whose surface that is; none: it is `own` */
    /* what kiln_backend_set_surface, _set_radiosity and _set_probes were given last; NULL: nothing yet */
    const struct kiln_surface *own;
    const uint64_t *radiosity;
    const struct kiln_radiance_probes *probes;
    struct kiln_rows *rows;     /* likewise of kiln_backend_set_rows */
    struct kiln_groups *groups; /* and of kiln_backend_set_groups */
    struct kiln_aside starting; /* how `begin` went */
    bool ran[KILN_PASS_COUNT];  /* which passes kiln_backend_run was called for */
};

extern const struct kiln_backend_api kiln_backend_embree;
extern const struct kiln_backend_api kiln_backend_vulkan;

/* None of these is collective. A backend is used by one thread at a time and runs its own threads inside a call. */

/* Lists what the backend called `name` ("embree" or "vulkan") could run on, at most `room` entries; writes how many
 * there are to `count`. A machine without a driver has none: no error. */
int kiln_backend_devices(const char *name, struct kiln_device *list, size_t room, size_t *count,
                         struct kiln_error *error);

/* Creates the backend called `name`: "embree", "vulkan", or "auto", which takes Vulkan where there is a fit device that
 * is not software and starts, else Embree. KILN_NO_DEVICE when there is none of that name here. */
int kiln_backend_create(struct kiln_backend **backend, const char *name, const struct kiln_backend_params *params,
                        struct kiln_error *error);
void kiln_backend_destroy(struct kiln_backend **backend);

/* Hands over the surface (borrowed). Must come before any pass over tile runs. */
int kiln_backend_set_surface(struct kiln_backend *backend, const struct kiln_surface *surface,
                             struct kiln_error *error);
/* From now on stealable passes run over these tile runs of another rank; none: over the own surface again. A device
 * keeps what it has of its own meanwhile. */
int kiln_backend_set_others(struct kiln_backend *backend, struct kiln_others others, struct kiln_error *error);
/* Hands over the radiosity of all points, packed, surface->point_count values (borrowed until the next call). Must come
 * before any pass that reads radiosity. */
int kiln_backend_set_radiosity(struct kiln_backend *backend, const uint64_t *radiosity, struct kiln_error *error);
/* From now on rays of the gather pass end at the probes' range and ask them (worker/pass/gather.h), at points whose
 * word `near_probes` names one that they see; the surface has these words. Borrowed until the next call, after which
 * `data` may have changed. NULL: rays have no end, as at first. */
int kiln_backend_set_probes(struct kiln_backend *backend, const struct kiln_radiance_probes *probes,
                            struct kiln_error *error);
/* From now on the gather pass keeps what its rays meet in a file, or takes it from there (worker/pass/rows.h). Borrowed
 * until the next call; NULL: neither, as at first. */
static inline void kiln_backend_set_rows(struct kiln_backend *backend, struct kiln_rows *rows) { backend->rows = rows; }
/* From now on the direct and the gather pass find the light of each group beside that of all (worker/pass/groups.h).
 * Borrowed until the next call; NULL: they do not, as at first. */
static inline void kiln_backend_set_groups(struct kiln_backend *backend, struct kiln_groups *groups)
{
    backend->groups = groups;
}
/* Runs a pass over a batch's items and hands the results to the batch's taker. `parameters` is the pass's own struct,
 * as its header says; NULL for a pass without. Adds the number of rays that were traced to *rays, counted as the pass's
 * header says, the same on all backends. When it fails, the parts that were taken before stand. */
int kiln_backend_run(struct kiln_backend *backend, const struct kiln_pass *pass, const void *parameters,
                     const struct kiln_batch *batch, uint64_t *rays, struct kiln_error *error);
/* Whether the backend whose info this is claims a batch with claims part by part (kiln_claims), as a device does, which
 * would be idle between batches: such a batch may have all that is left. Others, and all with rows, it claims as a
 * whole. `mixed`: it has samples_each. */
static inline bool kiln_backend_claims(const struct kiln_backend_info *info, const struct kiln_pass *pass, bool mixed)
{
    return ((mixed ? info->claims & info->mixed : info->claims) >> pass->index & 1u) != 0;
}
/* Whether kiln_backend_run takes the pass with these parameters, now: devices leave some to Embree (worker/pass/land.h,
 * weighed.h, reference.h), with KILN_USAGE. */
static inline bool kiln_backend_takes(const struct kiln_backend *backend, const struct kiln_pass *pass,
                                      const void *parameters)
{
    return backend->api->takes == NULL || backend->api->takes(backend, pass, parameters);
}
/* The pass will come with such parameters, over the surface that the backend has: a device begins to make its kernels,
 * beside what runs before it. To be called for what comes for certain, since ending waits for kernels that are being
 * made. Parameters are read only during the call. */
static inline void kiln_backend_expect(struct kiln_backend *backend, const struct kiln_pass *pass,
                                       const void *parameters)
{
    if (backend->api->expect != NULL && kiln_backend_takes(backend, pass, parameters))
        backend->api->expect(backend, pass, parameters);
}
/* The lights, the sky and the materials' colours of the scene and of `lights` that the backend was created with have
 * changed, in the place where they were: must come before the next pass. Geometry, and what of materials rays meet, are
 * as before. */
int kiln_backend_change_light(struct kiln_backend *backend, struct kiln_error *error);
/* Whether kiln_backend_replay is there: the rows that the gather pass fills in memory then are for it alone. */
static inline bool kiln_backend_replays(const struct kiln_backend *backend) { return backend->api->replay != NULL; }
/* The gather pass over a batch's tile runs under `count` lights at once, at most KILN_ROW_LIGHTS, from rows in memory
 * that are all ready (resident_rows.h) and have the batch's samples. `lights`: of each the radiosity of all points,
 * packed. The batch's taker gets `count` results a point, side by side, each with the bits of the gather pass. */
int kiln_backend_replay(struct kiln_backend *backend, struct kiln_rows *rows, const uint64_t *const *lights,
                        size_t count, const struct kiln_batch *batch, struct kiln_error *error);
/* Whether light may stay here at all (worker/pass/held.h). */
static inline bool kiln_backend_holds(const struct kiln_backend *backend) { return backend->api->hold != NULL; }
/* Light that stays on the device. Brings what it begins with, in the place of what was there, or makes it where it is
 * mixed; *held false: it does not stay here, for there is no room, say. `powers`: KILN_HELD_POWERS of each light; those
 * of lights that are not mixed mean nothing. After a failure what was held is lost; KILN_NO_DEVICE: other calls may go
 * on. */
int kiln_backend_hold(struct kiln_backend *backend, const struct kiln_held *begin, bool *held,
                      struct kiln_held_power *powers, struct kiln_error *error);
/* One step of all lights: the gather from the rows, as kiln_backend_replay, over all tile runs. The batch has no taker.
 * `powers`: KILN_HELD_POWERS of each light. */
int kiln_backend_hold_step(struct kiln_backend *backend, struct kiln_rows *rows, const struct kiln_batch *batch,
                           const struct kiln_held_step *step, struct kiln_held_power *powers, struct kiln_error *error);
/* After a final step: the light of each point, and its errors. */
int kiln_backend_hold_fetch(struct kiln_backend *backend, uint32_t light, const struct kiln_held_fetch *to,
                            struct kiln_error *error);
/* Surface regression (worker/pass/regression.h). *done false: the caller has to do it, for this backend has no device,
 * or a device too little room. Results that were taken are of no use then, nor after a failure. */
int kiln_backend_regress(struct kiln_backend *backend, const struct kiln_regression_work *work, bool *done,
                         struct kiln_error *error);
/* Traces about `samples` particles from the lights: made on the host, in batches, in the same way for every backend
 * (emission.c). */
int kiln_backend_emission(struct kiln_backend *backend, uint32_t samples, struct kiln_emission_result *result,
                          struct kiln_error *error);
/* Closest hits of any rays (origins relative to the centre, directions of unit length): views, checks and benches. */
int kiln_backend_intersect(struct kiln_backend *backend, const struct kiln_vec3 *origins,
                           const struct kiln_vec3 *directions, size_t count, struct kiln_hit *hits,
                           struct kiln_error *error);
/* The same where nothing counts that is `lengths` or farther off, m: such a hit may be given, or none. A ray of length
 * 0 need not be traced. Rays of which neighbours go much the same way are traced soonest. */
int kiln_backend_intersect_within(struct kiln_backend *backend, const struct kiln_vec3 *origins,
                                  const struct kiln_vec3 *directions, const float *lengths, size_t count,
                                  struct kiln_hit *hits, struct kiln_error *error);
/* Closest hits of rays whose neighbours in the arrays go much the same way, which a backend may trace together. */
int kiln_backend_intersect_alike(struct kiln_backend *backend, const struct kiln_vec3 *origins,
                                 const struct kiln_vec3 *directions, size_t count, struct kiln_hit *hits,
                                 struct kiln_error *error);
/* How far off the middles of spheres rays that begin there meet nothing, m, but for rounding: at most the radius and a
 * little more, less rather than too much, and 0 where it is not known, as on devices. */
int kiln_backend_clearance(struct kiln_backend *backend, const struct kiln_sphere *spheres, size_t count, float *clear,
                           struct kiln_error *error);
/* For benches: the gather pass's own rays over a batch, in the same packets and order, traced by the tracer alone; adds
 * the seconds that its calls took and the number of rays. One thread. Nothing is taken. */
int kiln_backend_ceiling(struct kiln_backend *backend, const struct kiln_batch *batch, double *seconds, uint64_t *rays,
                         struct kiln_error *error);
static inline void kiln_backend_info(const struct kiln_backend *backend, struct kiln_backend_info *info)
{
    backend->api->info(backend, info);
}

#endif
