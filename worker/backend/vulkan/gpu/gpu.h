/* Vulkan compute on a device: selection, memory, kernels, execution in slices of time. It is independent of light
 * transport.
 *
 * All data is accessed by buffer device address: kernels have no descriptors, only push constants (at most 128 bytes),
 * which contain the addresses. A gpu is used by one thread at a time. None of these is collective. Status codes:
 * KILN_NO_DEVICE when there is no suitable device or it was lost, KILN_SYSTEM for failures of the host; the message
 * says what was requested. */
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

/* Injected faults, for tests of error handling, and the number of Vulkan calls counted for them: VK_ERROR_DEVICE_LOST,
 * VK_ERROR_OUT_OF_DEVICE_MEMORY, and guarded buffers (below). The struct outlives the gpu, so that a replacement gpu
 * continues counting. */
struct gpu_faults {
    struct kiln_device_faults wanted;
    uint64_t calls;
};

struct gpu_choice {
    /* index in gpu_list; -1: the local_rank-th suitable device, in turn; software devices only if there is no hardware
     * device */
    int32_t device;
    uint32_t local_rank, local_ranks; /* of this node; 0, 0: alone. Ranks that share a device share its memory. */
    double slice_seconds;             /* maximum duration of a dispatch, s; 0: 0.1 */
    uint32_t threads;                 /* host threads that copy large uploads; 0: one */
    uint64_t memory_limit; /* bytes; 0: what the device's budget allows (VK_EXT_memory_budget, else 80 % of the heap) */
    /* The validation layer, whose warnings and errors are printed and counted (gpu_messages). The environment variable
     * KILN_VULKAN_VALIDATION=1 turns it on too, =gpu also looks into shaders (GPU-assisted validation; of no use on
     * software devices: see guarded buffers below). */
    bool validation;
    /* Disables ray tracing, since a driver needs 0.2 s to start it (one H200): the device is described as if it had
     * none. */
    bool compute_only;
    struct gpu_faults *faults;        /* borrowed; NULL: none */
    struct kiln_kernel_store kernels; /* store of compiled kernels */
};

/* Creates a gpu; if the device is lost or out of memory meanwhile, it tries three times. On success `error` is
 * unchanged. */
int gpu_create(struct gpu **gpu, const struct gpu_choice *choice, struct kiln_error *error);
void gpu_destroy(struct gpu **gpu);
const struct kiln_device *gpu_about(const struct gpu *gpu);
double gpu_slice(const struct gpu *gpu);
/* State after a failure. gpu_lost: the device is gone; only gpu_buffer_destroy, gpu_kernel_destroy and gpu_destroy may
 * be called, and another gpu can be created. gpu_short_of_memory: the device had too little memory for a request (no
 * buffer has been created since); a smaller one may succeed. */
bool gpu_lost(const struct gpu *gpu);
bool gpu_short_of_memory(const struct gpu *gpu);
/* Number of warnings and errors that the validation layers have reported so far. */
size_t gpu_messages(const struct gpu *gpu);
/* gpu_memory_left: bytes that may still be allocated within the budget or limit. gpu_memory_used: bytes allocated now.
 */
uint64_t gpu_memory_left(const struct gpu *gpu);
uint64_t gpu_memory_used(const struct gpu *gpu);

/* A buffer. `mapped` is NULL for device memory. Buffers are destroyed by gpu_buffer_destroy, before their gpu; it waits
 * for work in flight. */
enum gpu_memory {
    GPU_DEVICE, /* fast for kernels; filled and read by gpu_upload and gpu_download */
    GPU_HOST    /* mapped, cached and coherent; kernels may write it too */
};
struct gpu_buffer {
    uint64_t address; /* device address; a multiple of 64, or 4 when guarded */
    size_t size;      /* bytes */
    void *mapped;
    struct gpu_buffer_memory *memory; /* private */
};
/* Creates a buffer. KILN_NO_DEVICE, with the numbers, when it does not fit. `what` names it in messages: "the BVH".
 * Size 0 gives address 0. */
int gpu_buffer_create(struct gpu *gpu, struct gpu_buffer *buffer, size_t size, enum gpu_memory memory, const char *what,
                      struct kiln_error *error);
void gpu_buffer_destroy(struct gpu *gpu, struct gpu_buffer *buffer);
/* Copy to and from a buffer. Both run after all earlier submissions and wait until done; sizes beyond the staging
 * buffer are split. */
int gpu_upload(struct gpu *gpu, const struct gpu_buffer *buffer, size_t offset, const void *data, size_t size,
               struct kiln_error *error);
int gpu_download(struct gpu *gpu, const struct gpu_buffer *buffer, size_t offset, void *data, size_t size,
                 struct kiln_error *error);
/* As gpu_upload, for memory that no work in flight uses: it does not wait for that work, and runs in parallel with its
 * kernels if the device has a queue for copies. */
int gpu_fill(struct gpu *gpu, const struct gpu_buffer *buffer, size_t offset, const void *data, size_t size,
             struct kiln_error *error);
/* Combines gpu_buffer_create of GPU_DEVICE and gpu_fill of the whole buffer. */
int gpu_buffer_of(struct gpu *gpu, struct gpu_buffer *buffer, const void *data, size_t size, const char *what,
                  struct kiln_error *error);

/* Guarded buffers detect accesses out of bounds and reads of unwritten memory. They need a software device, whose
 * memory belongs to the process; for a hardware device gpu_create returns KILN_NO_DEVICE. With KILN_GUARD_AFTER every
 * buffer ends, to the byte, in front of 256 KiB of inaccessible memory; with KILN_GUARD_BEFORE it begins behind such
 * memory. An access to it by a kernel, a copy or the host ends the process with SIGSEGV, after a message on stderr:
 * which kernel, read or write, which byte of which buffer. The space between a buffer's other end and its page is
 * checked when the buffer is destroyed; if it was written, the process ends with SIGABRT. The memory of destroyed
 * buffers remains inaccessible until the gpu is destroyed. Buffers begin filled with 0xff: NaN as a float, as an index
 * or address far from everything.
 *
 * Accesses within a buffer, from one array to another, are not detected. So code that keeps several arrays in a buffer,
 * or a buffer larger than its content, uses the functions below. */
bool gpu_guarded(const struct gpu *gpu);
/* Offset at which to put `size` bytes, so that they end with the buffer if ends are guarded; else 0. */
size_t gpu_buffer_tail(const struct gpu *gpu, const struct gpu_buffer *buffer, size_t size);
/* Discards the buffer's content: overwrites it with 0xff when guarded. No work in flight may use it. */
void gpu_buffer_forget(const struct gpu *gpu, const struct gpu_buffer *buffer);

/* A kernel: one shader's SPIR-V and the values of its specialisation constants 0 .. constant_count-1 (all 32 bits).
 * Compute shaders define their workgroup size (local_size_x = 64), and are started with a number of threads. */
struct gpu_kernel_params {
    const char *name; /* for messages and timings */
    const struct gpu_code *code;
    const uint32_t *constants;
    size_t constant_count;
    /* ray tracing: the other shaders; `code` is the ray generation shader. NULL for compute. */
    const struct gpu_hit_shaders *hit_shaders;
};
/* One hit group: closest hit, and any hit for non-opaque geometry; and a miss shader. Each may be NULL but the miss
 * shader. */
struct gpu_hit_shaders {
    const struct gpu_code *closest_hit, *any_hit, *miss;
};
/* Reads the file of modules, for kernels whose code is in it; its path is the store's `file`. KILN_NO_DEVICE if it is
 * missing, or does not belong to this program (`of`). */
int gpu_code_read(struct gpu *gpu, const struct gpu_code_file *of, struct kiln_error *error);
/* Creates a kernel. Several threads at once may create compute kernels, and only these, unless faults are injected. */
int gpu_kernel_create(struct gpu *gpu, struct gpu_kernel **kernel, const struct gpu_kernel_params *params,
                      struct kiln_error *error);
void gpu_kernel_destroy(struct gpu *gpu, struct gpu_kernel **kernel);
/* Gives the numbers of kernels that were found in the store of compiled kernels, and that were compiled. */
void gpu_kernels_count(const struct gpu *gpu, uint64_t *found, uint64_t *made);

/* One step of a submission: a kernel over threads (x, y), or a copy. Steps and submissions run one after the other, and
 * each sees the results of the earlier ones (but for `alongside`). The host sees all results after waiting for the
 * submission. */
struct gpu_step {
    bool alongside; /* may run in parallel with the step before it: neither depends on the other */
    /* Marks a copy, the last step of a submission, of memory that no later submission writes before the caller has
     * waited for this one. Later submissions do not wait for the copy; if the device has a queue for copies, it runs in
     * parallel with their kernels. */
    bool aside;
    struct gpu_kernel *kernel; /* NULL: a copy */
    /* x is rounded up to workgroups of 64; more threads may start (kernels check). Any size is allowed, except for ray
     * tracing, where a device has a limit (usually 2^30 threads; KILN_BUG with the numbers beyond). If one of them is
     * 0, nothing runs. */
    uint32_t threads_x, threads_y;
    const void *constants; /* push constants, copied at once */
    size_t constant_bytes;
    const struct gpu_buffer *from, *to; /* copy: size bytes from from_offset to to_offset */
    size_t from_offset, to_offset, size;
};

enum { GPU_SLOTS = 3 }; /* maximum number of submissions in flight */

/* Submits the steps to the device and returns at once. `slot` must be free. It becomes free again by gpu_wait, even if
 * that fails, and if gpu_submit fails. */
int gpu_submit(struct gpu *gpu, uint32_t slot, const struct gpu_step *steps, size_t count, struct kiln_error *error);
/* Waits for a slot (a free one: no time); `seconds` (or NULL) gets the time its steps took on the device, by the
 * device's own clock, but for a copy aside. */
int gpu_wait(struct gpu *gpu, uint32_t slot, double *seconds, struct kiln_error *error);
/* Submit and wait, in a slot that is free. */
int gpu_run(struct gpu *gpu, const struct gpu_step *steps, size_t count, double *seconds, struct kiln_error *error);

/* Busy time of the device with submissions since it was created, s, and time since the first submission (for the idle
 * share). */
struct gpu_clock {
    double busy, elapsed;
};
void gpu_clock_read(const struct gpu *gpu, struct gpu_clock *clock);

/* Controls the amount of work in one dispatch: starts small, follows measurements, and stays just under the slice. Work
 * is counted in any unit that is roughly proportional to time (points, rays). */
struct gpu_pacer {
    double slice_seconds, rate; /* rate: work per second; 0: not known yet */
    uint64_t filling;           /* amount of work below which dispatches hardly got shorter; 0: unknown */
    uint64_t compared;          /* work and time of a dispatch with which the next much smaller one is compared */
    double compared_seconds;
};
uint64_t gpu_pacer_next(const struct gpu_pacer *pacer, uint64_t first_guess);
/* Amount of work for items that take unequal time, one thread each. A dispatch takes as long as its slowest thread, and
 * with too few threads the device is partly idle. So it returns at least `least`, and as much as is known to take
 * hardly longer, up to four times what would fill the slice. */
uint64_t gpu_pacer_next_filling(const struct gpu_pacer *pacer, uint64_t first_guess, uint64_t least);
void gpu_pacer_learn(struct gpu_pacer *pacer, uint64_t work, double seconds);

#endif
