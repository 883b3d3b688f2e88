/* A Vulkan device for compute: finding one, memory, kernels, running them in slices of time. Knows nothing of light.
 *
 * Everything is reached by buffer device address: kernels have no descriptors, only push constants (at most 128 bytes),
 * in which the addresses stand. A gpu is used by one thread at a time. None of these is collective. Status codes:
 * KILN_NO_DEVICE when there is no fit device or it was lost, KILN_SYSTEM for what the host refuses; the sentence says
 * what was asked for. */
#ifndef KILN_WORKER_BACKEND_VULKAN_GPU_GPU_H
#define KILN_WORKER_BACKEND_VULKAN_GPU_GPU_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "worker/backend/vulkan/gpu/code.h"
#include "worker/base/device.h"
#include "worker/base/kernel_store.h"
#include "worker/base/status.h"

struct gpu;
struct gpu_kernel;

/* Lists devices, at most `room`; writes how many there are to `count`. A machine without a loader or driver has none:
 * no error. */
int gpu_list(struct kiln_device *list, size_t room, size_t *count, struct kiln_error *error);

/* Faults on purpose, for tests of what happens then, and the Vulkan calls that were counted for them:
 * VK_ERROR_DEVICE_LOST, VK_ERROR_OUT_OF_DEVICE_MEMORY, and guarded buffers (below). The struct outlives the gpu, so
 * that one created in its place goes on counting. */
struct gpu_faults {
    struct kiln_device_faults wanted;
    uint64_t calls;
};

struct gpu_choice {
    /* index in gpu_list; -1: the local_rank-th fit device, in turn; software ones only when there is no real one */
    int32_t device;
    uint32_t local_rank, local_ranks; /* of this node; 0, 0: alone. Ranks that share a device share its memory. */
    double slice_seconds;             /* what one dispatch may take; 0: 0.1 */
    uint32_t threads;                 /* of the host, that copy large uploads; 0: one */
    uint64_t memory_limit; /* bytes; 0: what the device's budget allows (VK_EXT_memory_budget, else 80 % of the heap) */
    /* The validation layer, whose warnings and errors are printed and counted (gpu_messages). The environment variable
     * KILN_VULKAN_VALIDATION=1 turns it on too, =gpu also looks into shaders (GPU-assisted validation; of no use on
     * software devices: see guarded buffers below). */
    bool validation;
    /* Without ray tracing, whose parts of a driver start in 0.2 s (one H200): the device is described as if it had
     * none.
     */
    bool compute_only;
    struct gpu_faults *faults;        /* borrowed; NULL: none */
    struct kiln_kernel_store kernels; /* where compiled kernels are kept */
};

/* A device that is lost or out of memory while it starts is tried three times. On success `error` is left alone. */
int gpu_create(struct gpu **gpu, const struct gpu_choice *choice, struct kiln_error *error);
void gpu_destroy(struct gpu **gpu);
const struct kiln_device *gpu_about(const struct gpu *gpu);
double gpu_slice(const struct gpu *gpu);
/* After a failure: the device is gone, only gpu_buffer_destroy, gpu_kernel_destroy and gpu_destroy are of use, another
 * gpu can be created. Or: the device had too little memory for it (no buffer has been made since), and less may do. */
bool gpu_lost(const struct gpu *gpu);
bool gpu_short_of_memory(const struct gpu *gpu);
/* Warnings and errors that the validation layers have reported so far. */
size_t gpu_messages(const struct gpu *gpu);
/* Bytes that may still be allocated within the budget or limit, and that are allocated now. */
uint64_t gpu_memory_left(const struct gpu *gpu);
uint64_t gpu_memory_used(const struct gpu *gpu);

/* A buffer. `mapped` is NULL for memory of the device. Buffers die with gpu_buffer_destroy, before their gpu; what is
 * under way is waited for. */
enum gpu_memory {
    GPU_DEVICE, /* fast for kernels; filled and read by gpu_upload and gpu_download */
    GPU_HOST    /* mapped, cached and coherent; kernels may write it too */
};
struct gpu_buffer {
    uint64_t address; /* of the device; a multiple of 64, or 4 when guarded */
    size_t size;      /* bytes */
    void *mapped;
    struct gpu_buffer_memory *memory; /* private */
};
/* KILN_NO_DEVICE with the numbers when it does not fit. `what` names it in messages: "the BVH". Size 0 gives address 0.
 */
int gpu_buffer_create(struct gpu *gpu, struct gpu_buffer *buffer, size_t size, enum gpu_memory memory, const char *what,
                      struct kiln_error *error);
void gpu_buffer_destroy(struct gpu *gpu, struct gpu_buffer *buffer);
/* Both come after all submissions before them and wait until it is done; sizes beyond the staging buffer go in pieces.
 */
int gpu_upload(struct gpu *gpu, const struct gpu_buffer *buffer, size_t offset, const void *data, size_t size,
               struct kiln_error *error);
int gpu_download(struct gpu *gpu, const struct gpu_buffer *buffer, size_t offset, void *data, size_t size,
                 struct kiln_error *error);
/* gpu_upload to what nothing that is under way uses: it does not wait for that, and goes beside its kernels where the
 * device has a queue for copies. */
int gpu_fill(struct gpu *gpu, const struct gpu_buffer *buffer, size_t offset, const void *data, size_t size,
             struct kiln_error *error);
/* gpu_buffer_create of GPU_DEVICE and gpu_fill of the whole in one. */
int gpu_buffer_of(struct gpu *gpu, struct gpu_buffer *buffer, const void *data, size_t size, const char *what,
                  struct kiln_error *error);

/* Guarded buffers, to find accesses out of bounds and reads of what was never written. On a software device, whose
 * memory is the process's, KILN_GUARD_AFTER makes every buffer end, to the byte, where 256 KiB begin that nobody may
 * touch; KILN_GUARD_BEFORE makes it begin where such memory ends. gpu_create returns KILN_NO_DEVICE for a real device
 * then. A kernel, a copy or the host that does touch it ends the process with SIGSEGV, after a sentence on stderr:
 * which kernel, whether it reads or writes, which byte of which buffer. What lies between a buffer's other end and its
 * page is looked at when it is destroyed; has something been written there, the process ends with SIGABRT. The memory
 * of destroyed buffers may not be touched either, until the gpu is destroyed. Buffers begin filled with 0xff: NaN as a
 * float, as an index or address far from everything.
 *
 * Not seen: what goes wrong within a buffer, from one array to another. So whoever keeps more in a buffer than one
 * array, or a buffer larger than what it is for, asks these. */
bool gpu_guarded(const struct gpu *gpu);
/* Where in the buffer to put `size` bytes, so that they end with it when ends are guarded; else 0. */
size_t gpu_buffer_tail(const struct gpu *gpu, const struct gpu_buffer *buffer, size_t size);
/* Gives up what the buffer holds: overwritten with 0xff when guarded. Nothing under way may use it. */
void gpu_buffer_forget(const struct gpu *gpu, const struct gpu_buffer *buffer);

/* A kernel: one shader's SPIR-V and the values of its specialisation constants 0 .. constant_count-1 (all 32 bits).
 * Compute shaders have their workgroup size in the code (local_size_x = 64) and are started with a number of threads.
 */
struct gpu_kernel_params {
    const char *name; /* for messages and timings */
    const struct gpu_code *code;
    const uint32_t *constants;
    size_t constant_count;
    /* ray tracing: `code` is a ray generation shader; these are the others. NULL for compute. */
    const struct gpu_hit_shaders *hit_shaders;
};
/* One hit group: closest hit, and any hit for geometry that is not opaque; a miss shader. Any may be NULL but the miss
 * shader. */
struct gpu_hit_shaders {
    const struct gpu_code *closest_hit, *any_hit, *miss;
};
/* Reads the file of modules, for kernels whose code is in it; by the store's `file`. KILN_NO_DEVICE where it is not
 * there, or not `of` this program. */
int gpu_code_read(struct gpu *gpu, const struct gpu_code_file *of, struct kiln_error *error);
/* Compute kernels, and only they, may be made by several threads at once when there are no faults on purpose. */
int gpu_kernel_create(struct gpu *gpu, struct gpu_kernel **kernel, const struct gpu_kernel_params *params,
                      struct kiln_error *error);
void gpu_kernel_destroy(struct gpu *gpu, struct gpu_kernel **kernel);
/* Counts the kernels found where compiled ones are kept, and those that were compiled. */
void gpu_kernels_count(const struct gpu *gpu, uint64_t *found, uint64_t *made);

/* One step of a submission: a kernel over threads (x, y), or a copy. Steps run one after the other, submissions too,
 * each sees what the ones before it wrote (but for `alongside`); the host sees everything once the submission is waited
 * for. */
struct gpu_step {
    bool alongside; /* of the step before it: neither needs anything of the other */
    /* A copy that is a submission's last step, of what no submission to come writes before this one is waited for:
     * these do not wait for it, and where the device has a queue for copies it goes beside their kernels. */
    bool aside;
    struct gpu_kernel *kernel; /* NULL: a copy */
    /* x is rounded up to workgroups of 64, more may start (kernels check); any size but for ray tracing, where a device
     * has a limit (2^30 threads as a rule; KILN_BUG with the numbers beyond). 0 in one of them: nothing is done. */
    uint32_t threads_x, threads_y;
    const void *constants; /* push constants, copied at once */
    size_t constant_bytes;
    const struct gpu_buffer *from, *to; /* copy: size bytes from from_offset to to_offset */
    size_t from_offset, to_offset, size;
};

enum { GPU_SLOTS = 3 }; /* submissions that may be under way at once */

/* Hands the steps to the device and returns at once. `slot` must be free: it is again after gpu_wait, also when that
 * fails, and when gpu_submit fails. */
int gpu_submit(struct gpu *gpu, uint32_t slot, const struct gpu_step *steps, size_t count, struct kiln_error *error);
/* Waits for a slot (a free one: no time); `seconds` (or NULL) gets the time its steps took on the device, by the
 * device's own clock, but for a copy aside. */
int gpu_wait(struct gpu *gpu, uint32_t slot, double *seconds, struct kiln_error *error);
/* Submit and wait, in a slot that is free. */
int gpu_run(struct gpu *gpu, const struct gpu_step *steps, size_t count, double *seconds, struct kiln_error *error);

/* Seconds that the device has been busy with submissions since it was created, and (for the idle share) how long ago
 * the first of them was submitted. */
struct gpu_clock {
    double busy, elapsed;
};
void gpu_clock_read(const struct gpu *gpu, struct gpu_clock *clock);

/* How much work to put into one dispatch: starts small, follows what was measured, ends just under the slice. Work is
 * counted in anything that time is about proportional to (points, rays). */
struct gpu_pacer {
    double slice_seconds, rate; /* rate: work per second; 0: not known yet */
    uint64_t filling;           /* work below which dispatches were hardly shorter; 0: none is known */
    uint64_t compared;          /* work and time that the next much smaller dispatch is compared with */
    double compared_seconds;
};
uint64_t gpu_pacer_next(const struct gpu_pacer *pacer, uint64_t first_guess);
/* The same for work whose parts take unequal time, one thread each. A dispatch takes as long as its slowest thread, and
 * one with too few threads leaves the device idle: `least` at least, and as much as is known to take hardly longer, up
 * to four times what the slice is enough for. */
uint64_t gpu_pacer_next_filling(const struct gpu_pacer *pacer, uint64_t first_guess, uint64_t least);
void gpu_pacer_learn(struct gpu_pacer *pacer, uint64_t work, double seconds);

#endif
