/* Surface points on the device, in blocks: ranges of own tile runs whose points are made ready for sampling once and
 * stay there while there is room. When there is not, the block that was used longest ago makes way. */
#ifndef KILN_WORKER_BACKEND_VULKAN_POINTS_H
#define KILN_WORKER_BACKEND_VULKAN_POINTS_H

#include "worker/backend/backend.h"
#include "worker/backend/vulkan/gpu/gpu.h"
#include "worker/backend/vulkan/layout.h"
#include "worker/backend/vulkan/materials.h"

struct vulkan_block {
    size_t tile_run_first, tile_run_count;
    struct kiln_own_point first; /* its points */
    uint64_t count;
    struct gpu_buffer points, parts, states, list;
    struct gpu_buffer near_probes; /* words of surface->near_probes, where it has them */
    /* partly buried points, index within the block, ascending; the device's `list` holds the same */
    uint32_t *buried;
    uint32_t buried_count;
    /* the points that are computed, likewise, of a batch with selections; else none */
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
    struct vulkan_block *blocks;
    uint64_t clock;
    struct vulkan_points *idle;         /* whose blocks make way for these, all of them; NULL: there are none */
    double seconds;                     /* that bringing points took so far */
    uint64_t brought;                   /* points, once for each time */
    uint32_t threads;                   /* that make points */
    struct points_workspace *workspace; /* private: what blocks are made in, kept from one to the next */
    struct points_ahead *ahead;         /* private: the next block, which is made while the device is at work */
    bool smooth;                        /* some object has shading normals of its own */
    /* the batch whose items and points it leaves out have the state of points that are not valid; NULL: none.
     * Borrowed */
    const struct kiln_batch *chosen;
    bool mixed; /* their states hold their numbers of samples */
};

/* Threads for loops of a few operations a point while the device is at work: more would wait for each other at the end
 * of every loop, the longer the fewer cores are free for those that drive devices. */
static inline uint32_t vulkan_light_threads(uint32_t threads)
{
    const uint32_t most = 16, some = threads - threads / 8;
    return some < most ? some : most;
}

/* Borrows everything. Makes no block yet. */
int vulkan_points_create(struct vulkan_points **points, struct gpu *gpu, const struct kiln_backend_params *params,
                         const struct kiln_surface *surface, const struct vulkan_materials *materials,
                         struct kiln_error *error);
/* The same of some tile runs of another rank. Lasts for less time than `own`, of whose points none are asked for
 * meanwhile. */
int vulkan_points_of_others(struct vulkan_points **points, struct vulkan_points *own, const struct kiln_others *others,
                            struct kiln_error *error);
void vulkan_points_destroy(struct vulkan_points **points);

/* The block that holds `tile run`, on the device; `states`: with what surface->visible says now (else states are
 * undefined). The `in_use` blocks asked for last are not given up for it: the device may be at work on them.
 * KILN_NO_DEVICE when there is no room for it then. */
int vulkan_points_block(struct vulkan_points *points, size_t tile_run, bool states, uint32_t in_use,
                        struct vulkan_block **block, struct kiln_error *error);

/* Brings the states of all blocks that are on the device: at once, while it has nothing else to do. */
int vulkan_points_ready(struct vulkan_points *points, struct kiln_error *error);

/* surface->near_probes has changed. */
void vulkan_points_forget_probes(struct vulkan_points *points);

/* surface->visible has changed. */
void vulkan_points_forget_states(struct vulkan_points *points);

/* From now on the points of items that the batch leaves out, and those that are not in its masks, have the state of
 * points that are not valid, so that kernels pass them over. NULL, or a batch that has neither: none has. `mixed`: the
 * others' state holds their number of samples, too (KILN_GPU_STATE_SAMPLES_SHIFT). No kernel is at work; the batch is
 * borrowed until the next call. */
void vulkan_points_choose(struct vulkan_points *points, const struct kiln_batch *batch, bool mixed);

#endif
