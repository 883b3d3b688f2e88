/* Passes that sample the hemisphere over points: a kernel that takes slices of each point's samples
 * (shaders/hemisphere.glsl), and one that adds the slices up and makes results of them (hemisphere_reduce.glsl). */
#ifndef KILN_WORKER_BACKEND_VULKAN_HEMISPHERE_H
#define KILN_WORKER_BACKEND_VULKAN_HEMISPHERE_H

#include "worker/backend/vulkan/answers.h"
#include "worker/backend/vulkan/chunks.h"

/* Bytes that a pass's own push constants may have, after the members of struct kiln_gpu_hemisphere_push. */
enum { VULKAN_HEMISPHERE_OWN = VULKAN_CONSTANT_BYTES - sizeof(struct kiln_gpu_hemisphere_push) };

struct vulkan_hemisphere {
    const struct kiln_pass *pass;
    const struct vulkan_shader *shader, *sums; /* `shader` NULL: `finish` needs nothing before it */
    bool few_slices;                           /* no sums hang on slices: there need be no more than fill a device */
    bool chains; /* rays may go on in chains: the loops of a thread are longer than those of other passes */
    /* The kernels that follow chains apart, and add what these and others have found to the slices' sums
     * (shaders/gather_chains.glsl); NULL: the first kernel follows chains itself, or there are none. */
    const struct vulkan_shader *apart, *apart_sums;
    size_t apart_ray_bytes;           /* of what is kept of a ray for them */
    uint32_t apart_constant;          /* the own specialisation constant of `apart_sums` where it adds up */
    const uint64_t *apart_both;       /* an address that `apart` gets besides, as `prepare` has left it; NULL: none */
    uint32_t constant, sums_constant; /* the own specialisation constants of the first kernel, and of `sums` */
    uint32_t pace;                    /* whose speed it has: pass->index, or another of enum vulkan_pace */
    uint32_t stream;                  /* that random numbers hang on */
    uint32_t floats;                  /* of a slice */
    /* of which results' float a kernel makes a negative number to say that the device ended its loops early */
    size_t failed_offset;
    /* Where the device's results are short: their bytes, and what makes the pass's results of them. 0, NULL: they are
     * the pass's own. */
    size_t result_bytes;
    vulkan_lengthen lengthen;
    bool counts_rays; /* the word of a point is its shadow rays; each sample is a ray besides */
    const void *own;  /* its own push constants; NULL: none */
    size_t own_bytes; /* at most VULKAN_HEMISPHERE_OWN */
    /* its own push constants begin with the addresses of the radiance probes and of the words that say which of them
     * the points of a block see; with range 0 those that see one trace no rays */
    bool asks_probes;
    double *seconds; /* NULL, or what the device was busy is added here */
    /* The weighed pass, whose own push constants change when a device is made anew: they are those that this has set.
     * Called before the first chunk and after each recovery. NULL: nothing. */
    int (*prepare)(struct vulkan_backend *b, void *context, struct kiln_error *error);
    void *context; /* for `prepare` and `take_words` */
    /* Bytes of each point of the batch's tile runs, in order, whose address is the second of its own push constants;
     * kernels get that of the chunk's first point. 0: there are none. */
    size_t point_bytes;
    /* The gather pass from rows, which adds up and more in kernels of its own, in place of `sums`; its results are of
     * result_bytes. NULL: `sums` does. `room` is the address of room_bytes for each point of the chunk. */
    void (*finish)(struct vulkan_backend *b, const void *parameters, const struct vulkan_chunk *chunk, uint64_t room,
                   struct vulkan_recording *recording);
    bool holds; /* results stay on the device, which works on what is there alone: see struct vulkan_chunked */
    /* The first kernel leaves `kept_words` words for each point, whose address stands in the place of the second of the
     * pass's own push constants; `take_words` gets those of the tile runs whose results the batch's taker gets next. */
    uint32_t kept_words;
    int (*take_words)(void *context, size_t tile_run_first, size_t tile_run_count, const void *results,
                      const uint32_t *words, struct kiln_error *error);
    /* The light of groups is found besides (groups.h), from what rays have met: records it, after the sums. NULL:
     * nobody asks. The first kernel then leaves rows and weights, of whose addresses the two of its own push constants
     * are: kept_words, or row_bytes of each point's room; and what else there is of that. */
    void (*besides)(struct vulkan_backend *b, const void *parameters, const struct vulkan_chunk *chunk, uint64_t room,
                    struct vulkan_recording *recording);
    size_t row_bytes;
    size_t moved_bytes; /* of a point, that `bring` brings */
    /* The guided pass and the gather pass from rows, which have more to a chunk; NULL: nothing. Called before the first
     * portion of a chunk; fills the slot's `guides` by steps that it records. That buffer's address stands in the place
     * of the second of the pass's own push constants, and in struct kiln_gpu_guided_reduce_push. `room` is the address
     * of room_bytes for each point of the chunk. */
    int (*bring)(struct vulkan_backend *b, const void *parameters, const struct kiln_batch *batch,
                 const struct vulkan_chunk *chunk, uint64_t room, struct vulkan_recording *recording,
                 struct kiln_error *error);
    const void *parameters;              /* for `bring`, `finish` and `besides` */
    size_t room_bytes;                   /* of a point */
    const struct vulkan_shader *between; /* a kernel over all points, before `sums`; NULL: none */
};

/* The gather pass as it samples the hemisphere (gather.c), with two addresses of its own, which are filled in for each
 * chunk. */
struct vulkan_hemisphere vulkan_gather_pass(const struct vulkan_backend *b, const struct kiln_batch *batch,
                                            const uint64_t own[2]);

/* Runs the pass over the batch's points; adds its rays to *rays. */
int vulkan_hemisphere_run(struct vulkan_backend *b, const struct vulkan_hemisphere *pass,
                          const struct kiln_batch *batch, uint64_t *rays, struct kiln_error *error);

#endif
