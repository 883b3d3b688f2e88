/* Runs a pass over a range of tile runs in chunks: sized by time, several in flight at once, answers handed over in
 * order. */
#ifndef KILN_WORKER_BACKEND_VULKAN_CHUNKS_H
#define KILN_WORKER_BACKEND_VULKAN_CHUNKS_H

#include "worker/backend/vulkan/vulkan.h"

/* A chunk: points for which a pass records steps. Its rows (slices of samples) may be processed in several portions,
 * one after the other. */
struct vulkan_chunk {
    struct kiln_gpu_chunk all;    /* all points, a thread each */
    struct kiln_gpu_chunk buried; /* partly buried points; count 0: none */
    uint64_t scratch;             /* address; lasts from the first to the last portion */
    uint64_t results;             /* address: the pass's result of each point */
    uint64_t words;               /* address: the words of each point */
    uint64_t near_probes;         /* address: words of probes seen by each point of the block; 0: unknown */
    uint32_t row_first, row_count;
    bool last; /* the last portion: results and words must be complete after it */
    size_t tile_run_first, tile_run_count;
    uint32_t slot; /* slot of the backend; unused when the first portion is recorded */
};

enum { VULKAN_STEPS = 16, VULKAN_CONSTANT_BYTES = 128 };
struct vulkan_recording {
    struct gpu_step steps[VULKAN_STEPS];
    uint64_t constants[VULKAN_STEPS][VULKAN_CONSTANT_BYTES / sizeof(uint64_t)];
    size_t count;
};
/* Adds a kernel over (x, y) threads; the constants are copied. Does nothing if x or y is 0. */
void vulkan_record(struct vulkan_recording *recording, struct gpu_kernel *kernel, uint32_t x, uint32_t y,
                   const void *constants, size_t bytes);

/* Adds a copy of the first `size` bytes of a buffer to another. */
void vulkan_record_copy(struct vulkan_recording *recording, const struct gpu_buffer *from, const struct gpu_buffer *to,
                        size_t size);

/* Makes room for `bytes` bytes in the slot's `guides`; when it grows, for half as many again, since chunks grow. */
int vulkan_slot_room(struct vulkan_backend *b, struct vulkan_slot *slot, size_t bytes, const char *what,
                     struct kiln_error *error);

/* A dispatch of a kernel. vulkan_record_both adds two independent ones, which may run in parallel. The one with few
 * long threads comes first, so that the other's threads fill the device meanwhile. */
struct vulkan_dispatch {
    struct gpu_kernel *kernel;
    uint32_t x, y;
    const void *constants;
};
void vulkan_record_both(struct vulkan_recording *recording, const struct vulkan_dispatch both[2],
                        size_t constant_bytes);

/* How a pass runs in chunks. */
struct vulkan_chunked {
    const struct kiln_pass *pass;
    uint32_t pace; /* kind of work as which its speed is learned: pass->index, or another of enum vulkan_pace */
    /* uses the validity of points found by the validity pass; else all points */
    bool states;
    bool mixed; /* points may have different numbers of samples (vulkan_points_choose) */
    /* bytes of a point's result on the device: the size of the pass's result struct, or less if `take` completes it; 0:
     * only words, or nothing */
    size_t result_bytes;
    /* offset in a result of a float that a kernel makes negative if the device ended its loops early (results only) */
    size_t failed_offset;
    uint32_t rows;        /* slices of samples */
    double work;          /* estimated work, in rays, of one row of a point with the batch's `samples` */
    uint64_t first_guess; /* work of the first chunk, while the speed is unknown */
    size_t scratch_bytes; /* maximum scratch bytes a point */
    size_t (*scratch_of)(void *context, size_t tile_run); /* scratch bytes a point; NULL: scratch_bytes for all */
    bool keeps_rays;    /* scratch is mostly for rays: chunks have only points enough to fill a device */
    bool wants_words;   /* words are copied back to the host */
    uint32_t words;     /* words of a point; 0: one */
    size_t moved_bytes; /* bytes a point, besides results and a word, that are copied between host and device */
    int (*prepare)(void *context, struct kiln_error *error); /* gets kernels and tables; again after each recovery */
    int (*record)(void *context, const struct vulkan_chunk *chunk, struct vulkan_recording *recording,
                  struct kiln_error *error);
    /* Takes the answers of consecutive tile runs; words is NULL unless wanted. A status other than KILN_OK ends the
     * pass. takes_some: the batch may leave out some of them, whose answers are undefined, if its own taker is asked
     * the same way (kiln_batch.take_some). */
    bool takes_some;
    int (*take)(void *context, size_t tile_run_first, size_t tile_run_count, const void *results, const uint32_t *words,
                struct kiln_error *error);
    void *context;
    double *seconds; /* NULL, or sum to which the device's busy time is added */
    /* its data is on the device alone: the pass fails if the device is lost */
    bool holds;
};

/* Runs the pass over the batch's tile runs. The batch's taker is not called; `take` above may call it. After the loss
 * of a device, or lack of memory, the device is set up again, and the pass continues with the items that were not
 * handed over: see vulkan_recover. */
int vulkan_run_in_chunks(struct vulkan_backend *b, const struct vulkan_chunked *pass, const struct kiln_batch *batch,
                         struct kiln_error *error);

#endif
