/* A backend traces rays, on the CPU (embree/) or on a GPU (vulkan/). This header has the common functions: create, set,
 * run, query. extended.h has those that few callers need, and api.h the interface to implement.
 *
 * A backend holds the scene, the surface and the radiosity of all surface points, and runs passes (worker/pass/pass.h)
 * over batches of items. worker/pass describes the passes: their input, output, formulas and units. Neither this header
 * nor the neutral layer behind it (backend.c, extended.c, fallback.c, verify.c) knows a pass by name. The functions
 * below (kiln_backend_*) check their arguments once and call the backend. A backend knows no MPI. */
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
    const struct kiln_lights *direct_lights; /* lights that the direct pass samples, a subset of `lights`; NULL: all */
    uint32_t threads;                        /* 0: all of the machine's cores that this process may use */
    const char *instruction_set;             /* Embree's name ("avx2", ...); NULL: the best there is */
    uint64_t seed;
    uint64_t tree_memory; /* Embree's BVH is made compact where it would take more, bytes: same hits; 0: never */
    /* devices */
    uint32_t device;                  /* 1 + the number that `kiln info --devices` shows; 0: by local_rank */
    uint32_t local_rank, local_ranks; /* among the ranks of this node */
    enum kiln_traversal traversal;
    double rays;            /* expected rays of all passes; if few, traversals are not benchmarked; 0: unknown */
    double slice_seconds;   /* maximum duration of a dispatch, s; 0: 0.1 */
    uint64_t device_memory; /* maximum device memory, bytes; 0: all of the device's */
    /* surfaces of a chain before chance may end it (shaders/shared/chain.h); 0: KILN_CHAIN_LENGTH */
    uint32_t chain_length;
    bool goes_on;           /* continues with Embree after the device has failed for good (worker/backend/fallback.h) */
    double verify_fraction; /* share of tile runs that Embree traces again (worker/backend/verify.h); 0: none */
    /* stop request: ends creation, emission and validity early, with KILN_STOPPED; NULL: none */
    const struct kiln_stop *stop;
    struct kiln_kernel_store kernels; /* store of a device's compiled kernels */
    /* Passes that will run over the surface: bits KILN_PASS_INDEX_... A device's kernels for them are compiled in the
     * background. 0: unknown */
    uint32_t passes;
    bool regresses;                   /* kiln_backend_regress will be called: compiles its kernels in the background */
    struct kiln_backend_start *start; /* early start of a device, which creation continues (start.h); or NULL */
    struct kiln_device_faults faults; /* for tests */
};

struct kiln_hit {
    uint32_t triangle; /* world triangle, KILN_NONE: nothing */
    float u, v;
    float distance;
    bool back; /* hit from behind */
    /* transmittance, by colour, of the partly transparent surfaces before the hit; 1 without tinted ones */
    float tint[3];
};

enum { KILN_KERNELS_MOST = 32 };

/* A kernel that a device's driver made, or that was kept from an earlier run, and the seconds of that. */
enum { KILN_MADE_KERNELS = 5, KILN_MADE_CONSTANTS = 16 };
struct kiln_made_kernel {
    const char *name;                                        /* NULL: none */
    uint32_t constants[KILN_MADE_CONSTANTS], constant_count; /* its specialisation constants, by their numbers */
    double seconds;
};

struct kiln_backend_info {
    char name[32];    /* "embree" */
    char device[128]; /* "Embree 3.13.5, avx2, 2 threads" */
    size_t memory;    /* bytes held by the backend itself (its BVH and copies) */
    double build_seconds;
    double device_seconds; /* time that a device was busy with kernels and copies so far; 0: it has no clock */
    /* time, and processor time, s, that callers have waited so far for one-time work: compiling kernels, and uploading
     * data that stays on a device for kiln_backend_hold */
    double once_seconds, once_processor;
    uint64_t returned; /* bytes of results of passes over points that were returned to the host so far */
    /* processor time of the direct and gather passes so far, summed over threads, without waiting for each other; 0: a
     * device does the work */
    double thread_seconds;
    uint32_t take_threads;    /* most threads that are useful to take answers over; 0: any number */
    bool on_device;           /* a device does the work, in large batches: processor time does not tell its speed */
    bool makes_kernels;       /* kernels of a pass are compiled on first use, while the caller waits */
    bool keeps_chains;        /* rows also keep rays that continue from gloss or are tinted (row_chains.h) */
    bool computes_for_others; /* it runs stealable passes (worker/pass/pass.h) over tile runs of other ranks */
    bool keeps_points;        /* a device, on which points stay after their first upload */
    double point_seconds;     /* time to upload a point, if known; 0: none */
    bool regresses;           /* kiln_backend_regress is quicker than the host's own way */
    uint32_t mixed, claims;   /* passes with any mix of sample numbers; passes whose batches it claims part by part:
                               * kiln_backend_claims */
    bool compact_tree;        /* Embree's BVH is compact */
    uint64_t part_points;     /* approximate number of points in a part of a batch's results; 0: varies */
    uint32_t recoveries;      /* number of times that the device was lost or out of memory, and was set up again */
    /* the device failed for good and Embree continued: name, device, memory and build_seconds are Embree's */
    bool fell_back;
    /* names of what has computed so far: the passes of the Embree backend, the kernels of the Vulkan backend */
    const char *kernels[KILN_KERNELS_MOST];
    size_t kernel_count;
    /* numbers of a device's kernels that were cached from an earlier run, and that its driver had to compile */
    uint64_t kernels_found, kernels_made;
    struct kiln_aside starting, making; /* background work: starting a device, and making its kernels */
    struct kiln_made_kernel
        slowest[KILN_MADE_KERNELS]; /* those of its kernels that took longest to make, slowest first */
    uint64_t verified; /* texels traced again with Embree so far, once for each pass (worker/backend/verify.h) */
    uint64_t beyond;   /* number of these that differ by more than rounding and noise explain; a few may */
    double worst;      /* largest difference, relative to what rounding and noise explain */
};

/* The first member of each backend's own struct. */
struct kiln_backend {
    const struct kiln_backend_api *api;
    struct kiln_backend_params params;  /* as kiln_backend_create filled them in */
    struct kiln_resources given;        /* resources that it was given last */
    const struct kiln_surface *surface; /* surface that passes run over; NULL: none yet */
    struct kiln_aside starting;         /* timing of `begin` */
    bool ran[KILN_PASS_COUNT];          /* passes that kiln_backend_run was called for */
};

/* Functions of a backend are not collective (MPI). One thread at a time uses a backend, which runs its own threads
 * inside a call. */

/* Creates the backend called `name`: "embree", "vulkan", or "auto". "auto" takes Vulkan if there is a suitable hardware
 * device that starts, else Embree. KILN_NO_DEVICE: there is no backend of that name here. */
int kiln_backend_create(struct kiln_backend **backend, const char *name, const struct kiln_backend_params *params,
                        struct kiln_error *error);
void kiln_backend_destroy(struct kiln_backend **backend);

/* Returns the name that the backend was created by, never "auto". It stays the same after a fallback to Embree, which
 * kiln_backend_info shows. */
const char *kiln_backend_name(const struct kiln_backend *backend);

/* Hands over the surface (borrowed). Must come before any pass over tile runs. */
int kiln_backend_set_surface(struct kiln_backend *backend, const struct kiln_surface *surface,
                             struct kiln_error *error);
/* Hands over the radiosity of all points, packed, surface->point_count values (borrowed until the next call). Must come
 * before any pass that reads radiosity. */
int kiln_backend_set_radiosity(struct kiln_backend *backend, const uint64_t *radiosity, struct kiln_error *error);
/* Runs a pass over a batch's items and hands the results to the batch's taker. `parameters` is the pass's own struct,
 * as its header says; NULL for a pass without. Adds the number of rays that were traced to *rays, counted as the pass's
 * header says, the same on all backends. After a failure the parts that were already taken remain valid. */
int kiln_backend_run(struct kiln_backend *backend, const struct kiln_pass *pass, const void *parameters,
                     const struct kiln_batch *batch, uint64_t *rays, struct kiln_error *error);
/* Finds the closest hits of arbitrary rays (origins relative to the centre, directions of unit length): for views,
 * checks and benches. */
int kiln_backend_intersect(struct kiln_backend *backend, const struct kiln_vec3 *origins,
                           const struct kiln_vec3 *directions, size_t count, struct kiln_hit *hits,
                           struct kiln_error *error);
void kiln_backend_info(const struct kiln_backend *backend, struct kiln_backend_info *info);

#endif
