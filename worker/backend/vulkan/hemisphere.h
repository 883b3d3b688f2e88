/* Passes that sample the hemisphere over points. One kernel computes slices of each point's samples
 * (shaders/hemisphere.glsl); another sums the slices to results (hemisphere_reduce.glsl). */
#ifndef KILN_WORKER_BACKEND_VULKAN_HEMISPHERE_H
#define KILN_WORKER_BACKEND_VULKAN_HEMISPHERE_H

#include "worker/backend/vulkan/answers.h"
#include "worker/backend/vulkan/chunks.h"

/* Maximum size of a pass's own push constants, after the members of struct kiln_gpu_hemisphere_push. */
enum { VULKAN_HEMISPHERE_OWN = VULKAN_CONSTANT_BYTES - sizeof(struct kiln_gpu_hemisphere_push) };

struct vulkan_hemisphere {
    const struct kiln_pass *pass;
    const struct vulkan_shader *shader, *sums; /* first and summing kernel; `shader` NULL: only `finish` */
    bool few_slices;                           /* results do not depend on slices: few that fill a device suffice */
    bool chains; /* rays may continue in chains: a thread's loops are longer than in other passes */
    /* Kernels that trace chains separately, and add all findings to the slices' sums (shaders/gather_chains.glsl);
     * NULL: the first kernel traces chains itself, or there are none. */
    const struct vulkan_shader *apart, *apart_sums;
    size_t apart_ray_bytes;           /* bytes kept of a ray for these kernels */
    uint32_t apart_constant;          /* value of the own specialisation constant of `apart_sums` when it adds up */
    const uint64_t *apart_both;       /* additional address for `apart`, set by `prepare`; NULL: none */
    uint32_t constant, sums_constant; /* values of the own specialisation constants of the first kernel and of `sums` */
    uint32_t pace;                    /* work as which its speed is learned: pass->index, or of enum vulkan_pace */
    uint32_t stream;                  /* stream of random numbers */
    uint32_t floats;                  /* floats of a slice */
    /* offset of a float in the results that a kernel makes negative if the device ended its loops early */
    size_t failed_offset;
    /* Short results of the device: their size in bytes, and the function that converts them to the pass's results. 0,
     * NULL: results are not short. */
    size_t result_bytes;
    vulkan_lengthen lengthen;
    bool counts_rays; /* a point's word is its number of shadow rays; each sample is one more ray */
    const void *own;  /* pass's own push constants; NULL: none */
    size_t own_bytes; /* at most VULKAN_HEMISPHERE_OWN */
    /* the own push constants begin with two addresses: the radiance probes, and the words that say which probes the
     * points of a block see; with range 0 points that see a probe trace no rays */
    bool asks_probes;
    double *seconds; /* NULL, or sum to which the device's busy time is added */
    /* Sets the weighed pass's own push constants, which change when a device is set up again. Called before the first
     * chunk and after each recovery. NULL: not needed. */
    int (*prepare)(struct vulkan_backend *b, void *context, struct kiln_error *error);
    void *context; /* for `prepare` and `take_words` */
    /* Bytes a point of an array over the batch's tile runs, in order. Its address is the second of the own push
     * constants; kernels get the address of the chunk's first point. 0: there is none. */
    size_t point_bytes;
    /* Records the gather pass's own summing kernels for rows, in place of `sums`; its results have result_bytes. NULL:
     * `sums` is used. `room` is the address of room_bytes for each point of the chunk. */
    void (*finish)(struct vulkan_backend *b, const void *parameters, const struct vulkan_chunk *chunk, uint64_t room,
                   struct vulkan_recording *recording);
    bool holds; /* results stay on the device, whose data exist only there: see struct vulkan_chunked */
    /* Words that the first kernel writes for each point, at the address that is the second of the own push constants.
     * `take_words` gets the words of the tile runs whose results the batch's taker gets next. */
    uint32_t kept_words;
    int (*take_words)(void *context, size_t tile_run_first, size_t tile_run_count, const void *results,
                      const uint32_t *words, struct kiln_error *error);
    /* Records kernels for the light of groups (groups.h), computed from the rays' hits, after the sums. NULL: not
     * requested. The first kernel then writes rows and weights, to the two addresses in its own push constants:
     * kept_words, or row_bytes of each point's room; and the rest of that room. */
    void (*besides)(struct vulkan_backend *b, const void *parameters, const struct vulkan_chunk *chunk, uint64_t room,
                    struct vulkan_recording *recording);
    size_t row_bytes;
    size_t moved_bytes; /* bytes a point that `bring` uploads */
    /* Uploads additional data of a chunk, for the guided pass and the gather pass from rows; NULL: none. Called before
     * the first portion of a chunk; fills the slot's `guides` by steps that it records. That buffer's address becomes
     * the second of the pass's own push constants, and is in struct kiln_gpu_guided_reduce_push. `room` is the address
     * of room_bytes for each point of the chunk. */
    int (*bring)(struct vulkan_backend *b, const void *parameters, const struct kiln_batch *batch,
                 const struct vulkan_chunk *chunk, uint64_t room, struct vulkan_recording *recording,
                 struct kiln_error *error);
    const void *parameters;              /* for `bring`, `finish` and `besides` */
    size_t room_bytes;                   /* bytes of `room` a point */
    const struct vulkan_shader *between; /* a kernel over all points, before `sums`; NULL: none */
};

/* Describes the gather pass as a hemisphere pass (gather.c), with two own addresses, which are set for each chunk. */
struct vulkan_hemisphere vulkan_gather_pass(const struct vulkan_backend *b, const struct kiln_batch *batch,
                                            const uint64_t own[2]);

/* Runs the pass over the batch's points; adds its rays to *rays. */
int vulkan_hemisphere_run(struct vulkan_backend *b, const struct vulkan_hemisphere *pass,
                          const struct kiln_batch *batch, uint64_t *rays, struct kiln_error *error);

#endif
