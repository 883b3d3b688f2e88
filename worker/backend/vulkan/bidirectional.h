/* Paths that go both ways on the device, surface by surface: private to bidirectional.c, which says what a sample is
 * and has its memory, reference.c, whose paths begin at surface points, land.c, whose paths of light land there, and
 * bidirectional_stages.c, which runs the kernels of all. */
#ifndef KILN_WORKER_BACKEND_VULKAN_BIDIRECTIONAL_H
#define KILN_WORKER_BACKEND_VULKAN_BIDIRECTIONAL_H

#include "worker/backend/vulkan/vulkan.h"
#include "worker/light/emission.h"
#include "worker/pass/bidirectional.h"

/* A kernel, and whose speed is learned as its (enum vulkan_pace). */
struct both_stage {
    struct gpu_kernel *kernel;
    size_t pace;
};

enum { BOTH_QUEUE = 64 };

/* A call's working set. */
struct both_run {
    struct vulkan_backend *b;
    const struct kiln_bidirectional_parameters *p;
    uint32_t method;       /* KILN_GPU_BOTH_... */
    uint64_t first, count; /* pixels; or surface points of the batch */
    uint64_t paths;        /* of light in a sample, or those that are merged */
    uint32_t light_of;     /* KILN_GPU_OF_LIGHT..., of those that are traced next */
    bool buried;           /* of surface points: some that are partly buried begin next */
    bool shares;           /* of paths that land: they share their light with other techniques, */
    bool crosses;          /* or cross the spheres of probes */
    uint64_t rays;         /* that were traced */
    struct kiln_emission *emission;
    /* Whether paths that have met gloss and the others have kernels of their own: code for gloss makes a kernel slow
     * also where it does not run, for it takes a device's registers. */
    bool sorts;
    struct both_stage light_diffuse, eye_diffuse; /* of those others */
    struct both_stage light, eye, eye_ends, next, to_paths, to_camera, connected, near, connect, merge, splat, photon,
        buried_begin, begin_landing, met_first, cross;
    struct gpu_buffer chances, nodes, all, counts, vertices, last, photons, buckets, film, sums;
    struct gpu_buffer points, point_paths, point_rays; /* of paths from surface points */
    struct gpu_buffer brought;                         /* of the host: the film, or the sums of pixels */
    struct kiln_path_result *results;                  /* of pixels, for the taker */
    /* of paths under way: so many slots, and what hangs on each; lists of slots; what dispatches leave to do, of which
     * the last is copied to the host */
    uint32_t slots, pair_room, shadow_room;
    struct gpu_buffer subpaths, eyes, lands, radiance, lists, pairs, shadows, tallies, answer;
    uint32_t tally; /* the next */
    /* dispatches that are handed over together */
    struct both_queue {
        size_t count;
        size_t left;    /* of paths that land: the last whose tally tells how many go on */
        uint32_t tally; /* that of the first */
        double seconds; /* that they take, as far as is known */
        bool known;     /* it is, for all */
        struct kiln_gpu_both_push pushes[BOTH_QUEUE];
        struct gpu_step steps[BOTH_QUEUE + 1];
    } queue;
    struct kiln_gpu_both shared;
    struct kiln_gpu_both_push push;
};

/* Brings what the method needs, whose parameters, items and paths r has. */
int both_prepare(struct both_run *r, struct kiln_error *error);
void both_finish(struct both_run *r);
/* Brings what all threads of a sample share to the device. */
int both_upload(struct both_run *r, struct kiln_error *error);
/* Traces paths of light first .. first + count - 1, and connects them to the camera where there is one; again with more
 * room if they leave more vertices than there was room for. *counts: of their vertices. */
int both_trace_light(struct both_run *r, uint64_t first, uint64_t count, struct kiln_gpu_both_counts *counts,
                     struct kiln_error *error);
/* Puts the first `count` vertices into buckets. */
int both_sort_photons(struct both_run *r, uint32_t count, struct kiln_error *error);
/* Follows the paths of items first .. first + count - 1, and fails where the device could not. */
int both_follow(struct both_run *r, uint64_t first, uint64_t count, struct kiln_error *error);

/* Brings the kernels, which may have been made anew since; and makes the memory of paths under way besides. */
int both_kernels(struct both_run *r, struct kiln_error *error);
/* Begins to make them, for a run of which `b`, `method`, `crosses` and `shares` alone are known. */
void both_expect(struct both_run *r);
int both_stages_create(struct both_run *r, struct kiln_error *error);
void both_stages_destroy(struct both_run *r);

/* Sets memory of the device to 0, a multiple of 4 bytes. */
int both_clear(struct both_run *r, uint64_t address, uint64_t size, struct kiln_error *error);
/* Runs a kernel over threads first .. first + count - 1, a slice of time at once. `tally` (or NULL) gets what it has
 * left to do. */
int both_run_stage(struct both_run *r, const struct both_stage *stage, uint64_t first, uint64_t count,
                   struct kiln_gpu_both_tally *tally, struct kiln_error *error);

/* Puts words of zeros into a buffer on the device, which is made where it is too small. */
int both_make_zeros(struct both_run *r, struct gpu_buffer *buffer, size_t size, const char *what,
                    struct kiln_error *error);
/* Fails where the device has ended a loop early, or where one path has brought more than sums hold. */
int both_read_counts(struct both_run *r, struct kiln_gpu_both_counts *counts, struct kiln_error *error);

/* Hands over the start of `count` paths of light that land, and their first surfaces, as many as a queue is for.
 * both_wait_for_landings then waits for them and follows those that are left to their ends. The slot is free after it,
 * or after a failure of either. *seconds: time of what was handed over. */
int both_begin_landings(struct both_run *r, uint32_t slot, uint32_t count, struct kiln_error *error);
int both_wait_for_landings(struct both_run *r, uint32_t slot, double *seconds, struct kiln_error *error);

/* Traces paths of light first .. first + count - 1 of a sample, as many as there are slots at once. */
int both_light_paths(struct both_run *r, uint64_t first, uint64_t count, struct kiln_error *error);
/* Connects the first `count` vertices of light to the camera. */
int both_splats(struct both_run *r, uint64_t count, struct kiln_error *error);
/* Follows the paths of pixels first .. first + count - 1. */
int both_eye_paths(struct both_run *r, uint64_t first, uint64_t count, struct kiln_error *error);

#endif
