/* A backend: what traces rays, on the CPU (embree/) or on a GPU (vulkan/). For daily use: create, set, run, ask.
 * extended.h has what few callers need, and api.h how a backend is made.
 *
 * A backend holds the scene, the surface and the radiosity of all surface points, and runs passes (worker/pass/pass.h)
 * over batches of items. What passes there are, what they take and give, their formulas and units stand in worker/pass;
 * neither this header nor the neutral layer behind it (backend.c, extended.c, fallback.c, verify.c) knows a pass by
 * name. The functions below (kiln_backend_*) check their arguments once and call the backend. A backend knows no MPI.
 */
#ifndef KILN_WORKER_BACKEND_BACKEND_H
#define KILN_WORKER_BACKEND_BACKEND_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "worker/backend/resources.h"
#include "worker/base/clock.h"
#include "worker/base/device.h"
#include "worker/base/kernel_store.h"
#include "worker/base/stop.h"
#include "worker/pass/pass.h"
#include "worker/scene/scene.h"
#include "worker/scene/geometry.h"
#include "worker/scene/surface.h"

struct kiln_backend_api;
struct kiln_backend_start;

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
    bool on_device;           /* a device does the work, a lot of it at once, and no processor's time tells its speed */
    bool makes_kernels;       /* what a pass runs is made when it is first asked for, while the caller waits */
    bool keeps_chains;        /* rows keep rays that go on from gloss, or are tinted, too (worker/pass/row_chains.h) */
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

/* The first member of each backend's own struct. */
struct kiln_backend {
    const struct kiln_backend_api *api;
    struct kiln_backend_params params;  /* as kiln_backend_create filled them in */
    struct kiln_resources given;        /* what it was given last */
    const struct kiln_surface *surface; /* that passes run over; NULL: none yet */
    struct kiln_aside starting;         /* how `begin` went */
    bool ran[KILN_PASS_COUNT];          /* which passes kiln_backend_run was called for */
};

/* None of these is collective. A backend is used by one thread at a time and runs its own threads inside a call. */

/* Creates the backend called `name`: "embree", "vulkan", or "auto", which takes Vulkan where there is a fit device that
 * is not software and starts, else Embree. KILN_NO_DEVICE when there is none of that name here. */
int kiln_backend_create(struct kiln_backend **backend, const char *name, const struct kiln_backend_params *params,
                        struct kiln_error *error);
void kiln_backend_destroy(struct kiln_backend **backend);

/* The name that it was created by; "auto" is none. What has fallen back keeps it: kiln_backend_info tells. */
const char *kiln_backend_name(const struct kiln_backend *backend);

/* Hands over the surface (borrowed). Must come before any pass over tile runs. */
int kiln_backend_set_surface(struct kiln_backend *backend, const struct kiln_surface *surface,
                             struct kiln_error *error);
/* Hands over the radiosity of all points, packed, surface->point_count values (borrowed until the next call). Must come
 * before any pass that reads radiosity. */
int kiln_backend_set_radiosity(struct kiln_backend *backend, const uint64_t *radiosity, struct kiln_error *error);
/* Runs a pass over a batch's items and hands the results to the batch's taker. `parameters` is the pass's own struct,
 * as its header says; NULL for a pass without. Adds the number of rays that were traced to *rays, counted as the pass's
 * header says, the same on all backends. When it fails, the parts that were taken before stand. */
int kiln_backend_run(struct kiln_backend *backend, const struct kiln_pass *pass, const void *parameters,
                     const struct kiln_batch *batch, uint64_t *rays, struct kiln_error *error);
/* Closest hits of any rays (origins relative to the centre, directions of unit length): views, checks and benches. */
int kiln_backend_intersect(struct kiln_backend *backend, const struct kiln_vec3 *origins,
                           const struct kiln_vec3 *directions, size_t count, struct kiln_hit *hits,
                           struct kiln_error *error);
void kiln_backend_info(const struct kiln_backend *backend, struct kiln_backend_info *info);

#endif
