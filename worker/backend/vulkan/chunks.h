/* Running a pass over a range of tile runs in chunks: sized by time, several under way, answers handed over in order.
 */
#ifndef KILN_WORKER_BACKEND_VULKAN_CHUNKS_H
#define KILN_WORKER_BACKEND_VULKAN_CHUNKS_H

#include "worker/backend/vulkan/vulkan.h"

/* Piece of work that a pass records steps for. A chunk's rows (slices of samples) may come in several portions, one
 * after the other. */
struct vulkan_chunk {
    struct kiln_gpu_chunk all;    /* every point, thread by thread */
    struct kiln_gpu_chunk buried; /* those that are partly buried; count 0: none */
    uint64_t scratch;             /* address; lasts from the first to the last portion */
    uint64_t results;             /* address: the pass's result of each point */
    uint64_t words;               /* address: the words of each point */
    uint64_t near_probes;         /* address: of each point of the block, which probes it sees; 0: nobody knows */
    uint32_t row_first, row_count;
    bool last; /* the last portion: results and words must be complete after it */
    size_t tile_run_first, tile_run_count;
    uint32_t slot; /* of the backend's; nothing uses it when the first portion is recorded */
};

enum { VULKAN_STEPS = 16, VULKAN_CONSTANT_BYTES = 128 };
struct vulkan_recording {
    struct gpu_step steps[VULKAN_STEPS];
    uint64_t constants[VULKAN_STEPS][VULKAN_CONSTANT_BYTES / sizeof(uint64_t)];
    size_t count;
};
/* Adds a kernel over (x, y) threads; the constants are copied. Nothing for x or y of 0. */
void vulkan_record(struct vulkan_recording *recording, struct gpu_kernel *kernel, uint32_t x, uint32_t y,
                   const void *constants, size_t bytes);

/* Adds a copy of the first `size` bytes. */
void vulkan_record_copy(struct vulkan_recording *recording, const struct gpu_buffer *from, const struct gpu_buffer *to,
                        size_t size);

/* Room for so many bytes in the slot's `guides`; for half as many again where it grows, since chunks do. */
int vulkan_slot_room(struct vulkan_backend *b, struct vulkan_slot *slot, size_t bytes, const char *what,
                     struct kiln_error *error);

/* Two kernels, neither of which needs anything of the other: they may run side by side. What takes few threads long
 * goes first, so that the other's fill the device meanwhile. */
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
    uint32_t pace; /* whose speed it has: pass->index, or another of enum vulkan_pace */
    /* points as the validity pass left them; else all points */
    bool states;
    bool mixed; /* with their numbers of samples: it takes any (vulkan_points_choose) */
    /* bytes of a point's result on the device, which are those of the pass's result struct, or fewer where `take` makes
     * the rest; 0: there are words only, or nothing */
    size_t result_bytes;
    /* where in a result a float stands that a kernel makes negative to say that the device ended its loops early
     * (results only) */
    size_t failed_offset;
    uint32_t rows;        /* slices of samples */
    double work;          /* of one row of a point with the batch's `samples`: rays, about */
    uint64_t first_guess; /* work of the first chunk, when nothing is known yet */
    size_t scratch_bytes; /* a point, at most */
    size_t (*scratch_of)(void *context, size_t tile_run); /* of a point of a tile run; NULL: all have as many */
    bool keeps_rays;    /* of which it has most for rays: no more points than have rays enough to fill a device */
    bool wants_words;   /* else they are not copied back */
    uint32_t words;     /* of a point; 0: one */
    size_t moved_bytes; /* a point, that go between host and device besides results and a word */
    int (*prepare)(void *context, struct kiln_error *error); /* gets kernels and tables; again after each recovery */
    int (*record)(void *context, const struct vulkan_chunk *chunk, struct vulkan_recording *recording,
                  struct kiln_error *error);
    /* Answers of consecutive tile runs; words is NULL unless wanted. What it returns but for KILN_OK ends the pass. */
    int (*take)(void *context, size_t tile_run_first, size_t tile_run_count, const void *results, const uint32_t *words,
                struct kiln_error *error);
    void *context;
    double *seconds; /* NULL, or what the device was busy is added here */
    /* what it works on is on the device alone: when that is lost the pass fails */
    bool holds;
};

/* Over the batch's tile runs; its taker is not called, `take` above may do so. A device that was lost or has run out of
 * memory is made anew and the pass goes on with what had not been handed over yet: see vulkan_recover. */
int vulkan_run_in_chunks(struct vulkan_backend *b, const struct vulkan_chunked *pass, const struct kiln_batch *batch,
                         struct kiln_error *error);

#endif
