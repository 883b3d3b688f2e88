/* Inside of a gpu, for the files of this folder and for what builds on Vulkan itself (acceleration.c).
 *
 * Every Vulkan call that can fail stands in GPU_TRY, which counts it, plays faults and notes what failed; gpu_failure
 * then makes the sentence:
 *
 *     const VkResult result = GPU_TRY(gpu, vkCreateBuffer(gpu_vk_device(gpu), &info, NULL, &buffer));
 *     if (result != VK_SUCCESS)
 *         return gpu_failure(gpu, result, error, "cannot create a buffer of %zu bytes for %s", size, what);
 */
#ifndef KILN_WORKER_BACKEND_VULKAN_GPU_PRIVATE_H
#define KILN_WORKER_BACKEND_VULKAN_GPU_PRIVATE_H

#include <stdatomic.h>
#include <vulkan/vulkan.h>
#include <xxhash.h>

#include "worker/backend/vulkan/gpu/gpu.h"

enum {
    GPU_STAGING_PIECES = 2,
    GPU_STAGING_BYTES = 8 << 20, /* of one piece */
    GPU_ALL_SLOTS = GPU_SLOTS + GPU_STAGING_PIECES,
    GPU_PUSH_BYTES = 128,
    GPU_TIMED_STEPS = 64 /* of a submission, whose steps are timed one by one (times.c) */
};

/* Commands, and where their memory is from. */
struct gpu_commands {
    VkCommandPool pool;
    VkCommandBuffer buffer;
};

struct gpu_times;

struct gpu_slot {
    struct gpu_commands kernels, copies; /* for either queue */
    VkFence fence;                       /* of whichever is handed over last */
    VkQueryPool queries;                 /* when the kernels started and ended */
    VkSemaphore kernels_done;            /* a timeline, whose value is `submissions` once the kernels are done */
    uint64_t submissions;
    bool under_way, timed;
    /* where steps are timed one by one */
    const struct gpu_kernel *step_kernels[GPU_TIMED_STEPS]; /* NULL: a copy */
    uint64_t step_threads[GPU_TIMED_STEPS];
    uint32_t steps;
};

/* Functions of extensions; NULL without ray tracing. */
struct gpu_extensions {
    PFN_vkCreateRayTracingPipelinesKHR create_pipelines;
    PFN_vkGetRayTracingShaderGroupHandlesKHR group_handles;
    PFN_vkCmdTraceRaysKHR trace_rays;
    PFN_vkSetDebugUtilsObjectNameEXT set_name; /* NULL without validation */
};

struct gpu {
    struct kiln_device about;
    VkInstance instance;
    VkDebugUtilsMessengerEXT messenger;
    VkPhysicalDevice physical;
    VkDevice device;
    /* Kernels, and copies that come after them; copies that need not wait for kernels, nor these for them: the same
     * queue where a device has none that only copies. */
    VkQueue queue, copy_queue;
    uint32_t queue_family, copy_family;
    VkPhysicalDeviceLimits limits;
    VkPhysicalDeviceRayTracingPipelinePropertiesKHR ray_tracing;
    VkPhysicalDeviceMemoryProperties memory;
    VkDeviceSize largest_allocation;
    uint32_t heap; /* the device's own */
    bool knows_budget;
    uint32_t sharers; /* ranks on this device */
    uint64_t memory_limit, memory_used;
    double slice_seconds;
    uint32_t threads; /* that copy */
    struct gpu_extensions extensions;
    VkPipelineLayout compute_layout, tracing_layout;
    struct gpu_slot slots[GPU_ALL_SLOTS]; /* the last ones are for staging */
    struct gpu_buffer staging[GPU_STAGING_PIECES];
    struct gpu_guard *guard; /* NULL: buffers are not guarded */
    struct gpu_faults *faults;
    VkResult refusal;                  /* what the call that was just played a fault returns */
    atomic_bool lost, short_of_memory; /* threads that make kernels set them too */
    bool hangs;                        /* lost, in that it did not answer in time */
    atomic_size_t messages;
    double busy, first_submission; /* s; of the monotonic clock, 0: none yet */
    struct gpu_times *times;       /* NULL: steps are not timed one by one */
    struct kiln_kernel_store kernels;
    char *code_file;            /* modules of devices without doubles; NULL: not read */
    XXH128_hash_t identity;     /* of device and driver, and what stands in the driver's own header: */
    uint32_t vendor, device_id; /* of kept kernels */
    uint8_t cache_uuid[VK_UUID_SIZE];
    atomic_size_t kernels_found, kernels_made;
};

/* ---- calls that can fail ---- */

/* True when the next call is not to be made; gpu->refusal is its result. */
bool gpu_refuses(struct gpu *gpu);
VkResult gpu_outcome(struct gpu *gpu, VkResult result);
#define GPU_TRY(gpu, call) gpu_outcome((gpu), gpu_refuses(gpu) ? (gpu)->refusal : (call))
/* The format's sentence, then what the result means; returns the status code for it. */
int gpu_failure(const struct gpu *gpu, VkResult result, struct kiln_error *error, const char *format, ...)
    __attribute__((format(printf, 4, 5)));

/* ---- for acceleration.c ---- */

VkDevice gpu_vk_device(const struct gpu *gpu);
VkBuffer gpu_vk_buffer(const struct gpu_buffer *buffer);
/* bytes of the VkBuffer before the buffer's first: 0 without guard */
size_t gpu_buffer_skip(const struct gpu_buffer *buffer);
/* Records commands by calling back, runs them after all submissions so far and waits. A full barrier stands before and
 * after. */
typedef void (*gpu_record)(VkCommandBuffer commands, void *context);
int gpu_run_commands(struct gpu *gpu, gpu_record record, void *context, double *seconds, struct kiln_error *error);
/* All writes so far are seen by all that comes after, on the device and on the host. */
void gpu_barrier(VkCommandBuffer commands);
/* A name in messages of the validation layer; nothing without. */
void gpu_name(const struct gpu *gpu, VkObjectType type, uint64_t handle, const char *name);

/* ---- between the files of this folder ---- */

/* instance.c: an instance with the validation layer if asked for; `*instance` stays VK_NULL_HANDLE when no driver
 * is there. */
int gpu_instance_create(struct gpu *gpu, bool validation, VkInstance *instance, struct kiln_error *error);
/* list.c */
struct gpu_found {
    VkPhysicalDevice physical;
    struct kiln_device about;
};
/* The machine's devices in the order of gpu_list; free with kiln_free. */
int gpu_find(VkInstance instance, struct gpu_found **found, size_t *count, struct kiln_error *error);
bool gpu_has_extension(VkPhysicalDevice physical, const char *name);
/* submit.c */
int gpu_slots_create(struct gpu *gpu, struct kiln_error *error);
void gpu_slots_destroy(struct gpu *gpu);
/* Before something is destroyed: waits if anything is under way, whose slots stay taken. False: the device hangs, so
 * that waiting would have no end, and what is on it must be left alone. */
bool gpu_settle(const struct gpu *gpu);
int gpu_slot_begin(struct gpu *gpu, struct gpu_slot *slot, struct kiln_error *error);
int gpu_slot_end(struct gpu *gpu, struct gpu_slot *slot, struct kiln_error *error);
/* The same for copies alone, which do not wait for any kernel; in slot->copies. */
int gpu_slot_begin_copies(struct gpu *gpu, struct gpu_slot *slot, struct kiln_error *error);
int gpu_slot_end_copies(struct gpu *gpu, struct gpu_slot *slot, struct kiln_error *error);
int gpu_slot_wait(struct gpu *gpu, struct gpu_slot *slot, double *seconds, struct kiln_error *error);
void gpu_copy_record(const struct gpu *gpu, VkCommandBuffer commands, const struct gpu_step *copy);
/* memory.c */
int gpu_staging_create(struct gpu *gpu, struct kiln_error *error);
/* guard.c: buffers on memory whose surroundings nobody may touch, see gpu.h. Where nothing is said otherwise these
 * do nothing without. */
struct gpu_guarded {
    struct gpu_guarded *next;
    char what[64];
    VkDeviceMemory memory;
    unsigned char *begin, *end; /* the pages that may be touched */
    unsigned char *start;       /* the buffer */
    size_t size;
    size_t skip;         /* bytes of the VkBuffer before it */
    VkDeviceSize offset; /* of the VkBuffer in its memory */
    atomic_bool retired;
};
/* Guards buffers if the faults want that; KILN_NO_DEVICE for a real device. Before the VkDevice is made. */
int gpu_guard_create(struct gpu *gpu, struct kiln_error *error);
/* Once buffers can be made. */
int gpu_guard_start(struct gpu *gpu, struct kiln_error *error);
/* Gives back the memory of all buffers: after the last of them, before the VkDevice. */
void gpu_guard_destroy(struct gpu *gpu);
/* Bytes of the VkBuffer for a buffer, and of the memory for a VkBuffer that needs so much; the same without guard. */
size_t gpu_guard_buffer_size(const struct gpu *gpu, size_t size);
VkDeviceSize gpu_guard_memory_size(const struct gpu *gpu, VkDeviceSize needed);
/* Guarded only. Takes over memory of gpu_guard_memory_size bytes: the guard frees it, unless this fails and `guarded`
 * stays NULL. */
int gpu_guard_take(struct gpu *gpu, VkDeviceMemory memory, size_t size, const char *what, struct gpu_guarded **guarded,
                   struct kiln_error *error);
/* The buffer is destroyed; its memory may not be touched from now on. */
void gpu_guard_retire(struct gpu_guarded *guarded);
/* From here on the device is busy with a kernel of this name, a string that stays; NULL: with no kernel. */
void gpu_guard_mark(const struct gpu *gpu, VkCommandBuffer commands, const char *kernel);
/* code.c: the words of a kernel's stages, of compute kernels the first alone; NULL: there is no such stage */
enum { GPU_STAGE_MAIN, GPU_STAGE_MISS, GPU_STAGE_CLOSEST_HIT, GPU_STAGE_ANY_HIT, GPU_STAGES };
struct gpu_words {
    uint32_t *words;
    size_t bytes;
};
/* By any thread. Free the words with kiln_free. */
int gpu_code_unpack(const struct gpu *gpu, const struct gpu_code *code, struct gpu_words *words,
                    struct kiln_error *error);
/* kept.c */
struct gpu_kept {
    VkPipelineCache cache; /* what a kernel is made with; VK_NULL_HANDLE: nothing */
    char key[KILN_KERNEL_KEY + 1];
    bool found;
};
/* Learns what kept kernels must be for. */
void gpu_kept_identify(struct gpu *gpu);
/* Before a kernel is made, and after; `made`: it was. */
void gpu_kept_open(struct gpu *gpu, const struct gpu_kernel_params *params, const struct gpu_words words[GPU_STAGES],
                   struct gpu_kept *kept);
void gpu_kept_close(struct gpu *gpu, struct gpu_kept *kept, bool made);
/* times.c: gpu->times, NULL where steps are not timed one by one; then only the first two of these may be called. */
void gpu_times_create(struct gpu *gpu);
void gpu_times_destroy(struct gpu *gpu);
void gpu_times_add(struct gpu *gpu, const char *name, uint32_t constant, uint64_t threads, double seconds);
void gpu_times_make(struct gpu *gpu, const char *name, uint32_t constant, double seconds); /* by any thread */
void gpu_times_wait(struct gpu *gpu, double seconds);
/* kernel.c */
const char *gpu_kernel_name(const struct gpu_kernel *kernel);
uint32_t gpu_kernel_constant(const struct gpu_kernel *kernel); /* the last one */
int gpu_layouts_create(struct gpu *gpu, struct kiln_error *error);
void gpu_layouts_destroy(struct gpu *gpu);
void gpu_kernel_record(const struct gpu_kernel *kernel, VkCommandBuffer commands, const struct gpu_step *step,
                       const struct gpu *gpu);
/* KILN_BUG with the numbers when the device cannot start so many threads at once. */
int gpu_kernel_fits(const struct gpu_kernel *kernel, const struct gpu_step *step, const struct gpu *gpu,
                    struct kiln_error *error);

#endif
