/* Bidirectional paths on the device, traced surface by surface. Private to four files: bidirectional.c, which defines a
 * sample and owns its memory; reference.c, whose paths begin at surface points; land.c, whose light paths land there;
 * and bidirectional_stages.c, which runs the kernels of all. */
#ifndef KILN_WORKER_BACKEND_VULKAN_BIDIRECTIONAL_H
#define KILN_WORKER_BACKEND_VULKAN_BIDIRECTIONAL_H

#include "worker/backend/vulkan/vulkan.h"
#include "worker/light/emission.h"
#include "worker/pass/bidirectional.h"

/* A kernel, and the kind of work (enum vulkan_pace) as which its speed is learned. */
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
    uint64_t paths;        /* number of light paths in a sample, or of merged ones */
    uint32_t light_of;     /* KILN_GPU_OF_LIGHT...: kind of the light paths traced next */
    bool buried;           /* paths from surface points: some partly buried points begin next */
    bool shares;           /* paths that land: they are weighted against other techniques */
    bool crosses;          /* paths that land: they cross the spheres of probes */
    uint64_t rays;         /* number of traced rays */
    struct kiln_emission *emission;
    /* Whether paths at gloss and the others have separate kernels: code for gloss slows a kernel even where it does not
     * run, as it takes registers. */
    bool sorts;
    struct both_stage light_diffuse, eye_diffuse; /* stages of paths that are not at gloss */
    struct both_stage light, eye, eye_ends, next, to_paths, to_camera, connected, near, connect, merge, splat, photon,
        buried_begin, begin_landing, met_first, cross;
    struct gpu_buffer chances, nodes, all, counts, vertices, last, photons, buckets, film, sums;
    struct gpu_buffer points, point_paths, point_rays; /* of paths from surface points */
    struct gpu_buffer brought;                         /* host memory: the film, or the sums of pixels */
    struct kiln_path_result *results;                  /* results of pixels, for the taker */
    /* unfinished paths: number of slots, and data of each; lists of slots; counts of work that dispatches leave, of
     * which the last is copied to the host */
    uint32_t slots, pair_room, shadow_room;
    struct gpu_buffer subpaths, eyes, lands, radiance, lists, pairs, shadows, tallies, answer;
    uint32_t tally; /* next tally to use */
    /* dispatches that are submitted together */
    struct both_queue {
        size_t count;
        size_t left;    /* paths that land: the last dispatch whose tally counts the continuing paths */
        uint32_t tally; /* tally of the first dispatch */
        double seconds; /* expected time of the dispatches, as far as known */
        bool known;     /* the time of all is known */
        struct kiln_gpu_both_push pushes[BOTH_QUEUE];
        struct gpu_step steps[BOTH_QUEUE + 1];
    } queue;
    struct kiln_gpu_both shared;
    struct kiln_gpu_both_push push;
};

/* Uploads the method's data; r has parameters, items and paths. */
int both_prepare(struct both_run *r, struct kiln_error *error);
void both_finish(struct both_run *r);
/* Uploads the data that all threads of a sample share. */
int both_upload(struct both_run *r, struct kiln_error *error);
/* Traces light paths first .. first + count - 1, and connects them to the camera if there is one. If their vertices
 * find no room, it repeats this with more. *counts: of their vertices. */
int both_trace_light(struct both_run *r, uint64_t first, uint64_t count, struct kiln_gpu_both_counts *counts,
                     struct kiln_error *error);
/* Puts the first `count` vertices into buckets. */
int both_sort_photons(struct both_run *r, uint32_t count, struct kiln_error *error);
/* Traces the paths of items first .. first + count - 1; fails if the device could not. */
int both_follow(struct both_run *r, uint64_t first, uint64_t count, struct kiln_error *error);

/* Fetches the kernels, which may have been replaced since; allocates memory for unfinished paths. */
int both_kernels(struct both_run *r, struct kiln_error *error);
/* Begins to make the kernels in the background, for a run of which only `b`, `method`, `crosses` and `shares` are set.
 */
void both_expect(struct both_run *r);
int both_stages_create(struct both_run *r, struct kiln_error *error);
void both_stages_destroy(struct both_run *r);

/* Clears device memory; its size is a multiple of 4 bytes. */
int both_clear(struct both_run *r, uint64_t address, uint64_t size, struct kiln_error *error);
/* Runs a kernel over threads first .. first + count - 1, in slices of time. `tally` (or NULL) gets the counts of
 * remaining work. */
int both_run_stage(struct both_run *r, const struct both_stage *stage, uint64_t first, uint64_t count,
                   struct kiln_gpu_both_tally *tally, struct kiln_error *error);

/* Fills a device buffer with zero words; allocates it anew if it is too small. */
int both_make_zeros(struct both_run *r, struct gpu_buffer *buffer, size_t size, const char *what,
                    struct kiln_error *error);
/* Reads the counts; fails if the device has ended a loop early, or one path exceeds the range of the sums. */
int both_read_counts(struct both_run *r, struct kiln_gpu_both_counts *counts, struct kiln_error *error);

/* both_begin_landings submits the start of `count` light paths that land, and as many of their first surfaces as fit a
 * queue. both_wait_for_landings waits for that, and traces the unfinished paths to their ends. The slot is free
 * afterwards, or after a failure of either. *seconds: time of the submission. */
int both_begin_landings(struct both_run *r, uint32_t slot, uint32_t count, struct kiln_error *error);
int both_wait_for_landings(struct both_run *r, uint32_t slot, double *seconds, struct kiln_error *error);

/* Traces light paths first .. first + count - 1 of a sample, as many at once as there are slots. */
int both_light_paths(struct both_run *r, uint64_t first, uint64_t count, struct kiln_error *error);
/* Connects the first `count` light vertices to the camera. */
int both_splats(struct both_run *r, uint64_t count, struct kiln_error *error);
/* Traces the paths of pixels first .. first + count - 1. */
int both_eye_paths(struct both_run *r, uint64_t first, uint64_t count, struct kiln_error *error);

#endif
