/* Surface points on the device, in blocks. A block is a range of this rank's tile runs, whose points are prepared for
 * sampling once and stay on the device while there is memory. If memory is short, the least recently used block is
 * evicted. */
#ifndef KILN_WORKER_BACKEND_VULKAN_POINTS_H
#define KILN_WORKER_BACKEND_VULKAN_POINTS_H

#include "worker/backend/backend.h"
#include "worker/backend/vulkan/gpu/gpu.h"
#include "worker/backend/vulkan/layout.h"
#include "worker/backend/vulkan/materials.h"

struct vulkan_point_range {
    size_t tile_run_first, tile_run_count;
    struct kiln_own_point first; /* its points */
    uint64_t count;
    struct gpu_buffer points, parts, states, list;
    struct gpu_buffer near_probes; /* words of surface->near_probes, if the surface has them */
    /* partly buried points, index within the range, ascending; the device's `list` holds the same */
    uint32_t *buried;
    uint32_t buried_count;
    /* points to be computed, likewise, for a batch with selections; else none */
    struct gpu_buffer asked_list;
    uint32_t *asked;
    uint32_t asked_count;
    uint64_t last_used;
    bool resident, states_known;
};

struct vulkan_points {
    struct gpu *gpu;
    const struct kiln_backend_params *params;
    const struct kiln_surface *surface;
    const struct vulkan_materials *materials;
    size_t block_count;
    struct vulkan_point_range *blocks;
    uint64_t clock;
    struct vulkan_points *idle;         /* points whose blocks are all evicted for these; NULL: none */
    double seconds;                     /* time spent so far to upload points */
    uint64_t brought;                   /* number of uploaded points, counted at each upload */
    uint32_t threads;                   /* host threads that prepare points */
    struct points_workspace *workspace; /* private: buffers in which blocks are prepared, reused for the next */
    struct points_ahead *ahead;         /* private: the next block, prepared while the device is busy */
    bool smooth;                        /* some object has shading normals of its own */
    /* the batch: items and points that it leaves out get the state of invalid points; NULL: none. Borrowed */
    const struct kiln_batch *chosen;
    bool mixed; /* states of points contain their numbers of samples */
};

/* Number of threads for loops of a few operations a point while the device is busy. More threads would wait for each
 * other at the end of each loop, the longer the fewer cores are free for the threads that drive devices. */
static inline uint32_t vulkan_light_threads(uint32_t threads)
{
    const uint32_t most = 16, some = threads - threads / 8;
    return some < most ? some : most;
}

/* Makes the blocks of this rank's points. None of them is prepared or uploaded yet. All pointers are borrowed. */
int vulkan_points_create(struct vulkan_points **points, struct gpu *gpu, const struct kiln_backend_params *params,
                         const struct kiln_surface *surface, const struct vulkan_materials *materials,
                         struct kiln_error *error);
/* Creates points of some tile runs of another rank. They must be destroyed before `own`, none of whose points are
 * requested meanwhile. */
int vulkan_points_of_others(struct vulkan_points **points, struct vulkan_points *own, const struct kiln_others *others,
                            struct kiln_error *error);
void vulkan_points_destroy(struct vulkan_points **points);

/* Finds or uploads the block that contains `tile_run`. `states`: with the current states from surface->visible (else
 * they are undefined). The `in_use` blocks requested last are not evicted, as the device may be using them.
 * KILN_NO_DEVICE if there is no memory then. */
int vulkan_points_range(struct vulkan_points *points, size_t tile_run, bool states, uint32_t in_use,
                        struct vulkan_point_range **block, struct kiln_error *error);

/* Uploads the states of all blocks that are on the device, at once while the device is idle. */
int vulkan_points_ready(struct vulkan_points *points, struct kiln_error *error);

/* Drops uploaded probe words: surface->near_probes has changed. */
void vulkan_points_forget_probes(struct vulkan_points *points);

/* Drops uploaded states: surface->visible has changed. */
void vulkan_points_forget_states(struct vulkan_points *points);

/* Gives points that the batch leaves out, by its items or its masks, the state of invalid points from now on, so that
 * kernels skip them. NULL, or a batch that leaves out none: no point is skipped. `mixed`: the states of the others also
 * contain their number of samples (KILN_GPU_STATE_SAMPLES_SHIFT). No kernel may be running; the batch is borrowed until
 * the next call. */
void vulkan_points_choose(struct vulkan_points *points, const struct kiln_batch *batch, bool mixed);

#endif
