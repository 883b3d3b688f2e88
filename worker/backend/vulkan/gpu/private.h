/* Internals of a gpu, for the files of this folder and for code that uses Vulkan directly (acceleration.c).
 *
 * Every Vulkan call that can fail is wrapped in GPU_TRY, which counts it, injects faults and records failures;
 * gpu_failure then makes the message:
 *
 *     const VkResult result = GPU_TRY(gpu, vkCreateBuffer(gpu_vk_device(gpu), &info, NULL, &buffer));
 *     if (result != VK_SUCCESS)
 *         return gpu_failure(gpu, result, error, "cannot create a buffer of %zu bytes for %s", size, what); */
#ifndef KILN_WORKER_BACKEND_VULKAN_GPU_PRIVATE_H
#define KILN_WORKER_BACKEND_VULKAN_GPU_PRIVATE_H

#include <stdatomic.h>
#include <vulkan/vulkan.h>
#include <xxhash.h>

#include "worker/backend/vulkan/gpu/gpu.h"

enum {
    GPU_STAGING_PIECES = 2,
    GPU_STAGING_BYTES = 8 << 20, /* bytes of one staging buffer */
    GPU_ALL_SLOTS = GPU_SLOTS + GPU_STAGING_PIECES,
    GPU_PUSH_BYTES = 128,
    GPU_TIMED_STEPS = 64 /* maximum steps of a submission that are timed one by one (times.c) */
};

/* A command buffer, and its pool. */
struct gpu_commands {
    VkCommandPool pool;
    VkCommandBuffer buffer;
};

struct gpu_times;

struct gpu_slot {
    struct gpu_commands kernels, copies; /* commands for both queues */
    VkFence fence;                       /* signalled by the last submission */
    VkQueryPool queries;                 /* timestamps of the kernels' start and end */
    VkSemaphore kernels_done;            /* a timeline, whose value is `submissions` once the kernels are done */
    uint64_t submissions;
    bool under_way, timed;
    /* used only if steps are timed one by one */
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
    /* `queue`: kernels, and copies ordered with them. `copy_queue`: copies that are independent of kernels; the same
     * queue if the device has none only for copies. */
    VkQueue queue, copy_queue;
    uint32_t queue_family, copy_family;
    VkPhysicalDeviceLimits limits;
    VkPhysicalDeviceRayTracingPipelinePropertiesKHR ray_tracing;
    VkPhysicalDeviceMemoryProperties memory;
    VkDeviceSize largest_allocation;
    uint32_t heap; /* index of the device's own memory heap */
    bool knows_budget;
    uint32_t sharers; /* ranks on this device */
    uint64_t memory_limit, memory_used;
    double slice_seconds;
    uint32_t threads; /* host threads that copy uploads */
    struct gpu_extensions extensions;
    VkPipelineLayout compute_layout, tracing_layout;
    struct gpu_slot slots[GPU_ALL_SLOTS]; /* the last ones are for staging */
    struct gpu_buffer staging[GPU_STAGING_PIECES];
    struct gpu_guard *guard; /* NULL: buffers are not guarded */
    struct gpu_faults *faults;
    VkResult refusal;                  /* result of the call for which a fault was injected */
    atomic_bool lost, short_of_memory; /* threads that make kernels set them too */
    bool hangs;                        /* lost because it did not answer in time */
    atomic_size_t messages;
    double busy, first_submission; /* busy time, s; start of the first submission, s (monotonic), 0: none yet */
    struct gpu_times *times;       /* NULL: steps are not timed one by one */
    struct kiln_kernel_store kernels;
    char *code_file;            /* modules of devices without doubles; NULL: not read */
    XXH128_hash_t identity;     /* hash of device and driver; and the driver's own header of pipeline caches: */
    uint32_t vendor, device_id; /* vendor and device of kept kernels */
    uint8_t cache_uuid[VK_UUID_SIZE];
    atomic_size_t kernels_found, kernels_made;
};

/* ---- calls that can fail ---- */

/* Whether the next call must be skipped to inject a fault; gpu->refusal is its result. */
bool gpu_refuses(struct gpu *gpu);
VkResult gpu_outcome(struct gpu *gpu, VkResult result);
#define GPU_TRY(gpu, call) gpu_outcome((gpu), gpu_refuses(gpu) ? (gpu)->refusal : (call))
/* Writes the formatted message and the meaning of the result; returns the status code for it. */
int gpu_failure(const struct gpu *gpu, VkResult result, struct kiln_error *error, const char *format, ...)
    __attribute__((format(printf, 4, 5)));

/* ---- for acceleration.c ---- */

VkDevice gpu_vk_device(const struct gpu *gpu);
VkBuffer gpu_vk_buffer(const struct gpu_buffer *buffer);
/* returns the bytes of the VkBuffer before the buffer's first byte: 0 without guard */
size_t gpu_buffer_skip(const struct gpu_buffer *buffer);
/* Records commands through a callback, runs them after all submissions so far, and waits. Full barriers come before and
 * after. */
typedef void (*gpu_record)(VkCommandBuffer commands, void *context);
int gpu_run_commands(struct gpu *gpu, gpu_record record, void *context, double *seconds, struct kiln_error *error);
/* Records a barrier: all later commands, and the host, see all earlier writes. */
void gpu_barrier(VkCommandBuffer commands);
/* Names an object in messages of the validation layer; does nothing without it. */
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
/* Finds the machine's devices in the order of gpu_list; free with kiln_free. */
int gpu_find(VkInstance instance, struct gpu_found **found, size_t *count, struct kiln_error *error);
bool gpu_has_extension(VkPhysicalDevice physical, const char *name);
/* submit.c */
int gpu_slots_create(struct gpu *gpu, struct kiln_error *error);
void gpu_slots_destroy(struct gpu *gpu);
/* Waits for all work in flight, before something is destroyed; slots stay taken. False: the device hangs, so that
 * waiting would never end, and its objects must be left alone. */
bool gpu_settle(const struct gpu *gpu);
int gpu_slot_begin(struct gpu *gpu, struct gpu_slot *slot, struct kiln_error *error);
int gpu_slot_end(struct gpu *gpu, struct gpu_slot *slot, struct kiln_error *error);
/* Begin and end a submission of copies alone, which do not wait for any kernel; recorded in slot->copies. */
int gpu_slot_begin_copies(struct gpu *gpu, struct gpu_slot *slot, struct kiln_error *error);
int gpu_slot_end_copies(struct gpu *gpu, struct gpu_slot *slot, struct kiln_error *error);
int gpu_slot_wait(struct gpu *gpu, struct gpu_slot *slot, double *seconds, struct kiln_error *error);
void gpu_copy_record(const struct gpu *gpu, VkCommandBuffer commands, const struct gpu_step *copy);
/* memory.c */
int gpu_staging_create(struct gpu *gpu, struct kiln_error *error);
/* guard.c: buffers in memory with inaccessible surroundings, see gpu.h. Unless said otherwise these functions do
 * nothing without guard. */
struct gpu_guarded {
    struct gpu_guarded *next;
    char what[64];
    VkDeviceMemory memory;
    unsigned char *begin, *end; /* range of accessible pages */
    unsigned char *start;       /* the buffer */
    size_t size;
    size_t skip;         /* bytes of the VkBuffer before it */
    VkDeviceSize offset; /* offset of the VkBuffer in its memory */
    atomic_bool retired;
};
/* Enables guarding if the faults request it; KILN_NO_DEVICE for a hardware device. Call before the VkDevice is created.
 */
int gpu_guard_create(struct gpu *gpu, struct kiln_error *error);
/* Starts guarding, once buffers can be created. */
int gpu_guard_start(struct gpu *gpu, struct kiln_error *error);
/* Frees the memory of all buffers: call after the last of them, before the VkDevice is destroyed. */
void gpu_guard_destroy(struct gpu *gpu);
/* Return the bytes of the VkBuffer for a buffer, and of the memory for a VkBuffer that needs `needed`; unchanged
 * without guard. */
size_t gpu_guard_buffer_size(const struct gpu *gpu, size_t size);
VkDeviceSize gpu_guard_memory_size(const struct gpu *gpu, VkDeviceSize needed);
/* Takes over memory of gpu_guard_memory_size bytes (only with guard): the guard frees it, unless this fails and
 * `guarded` stays NULL. */
int gpu_guard_take(struct gpu *gpu, VkDeviceMemory memory, size_t size, const char *what, struct gpu_guarded **guarded,
                   struct kiln_error *error);
/* Marks a buffer as destroyed; its memory becomes inaccessible. */
void gpu_guard_retire(struct gpu_guarded *guarded);
/* Records a mark that the device runs a kernel of this name from here on, a string that persists; NULL: no kernel. */
void gpu_guard_mark(const struct gpu *gpu, VkCommandBuffer commands, const char *kernel);
/* code.c: SPIR-V words of a kernel's stages, for compute kernels only the first; NULL: no such stage */
enum { GPU_STAGE_MAIN, GPU_STAGE_MISS, GPU_STAGE_CLOSEST_HIT, GPU_STAGE_ANY_HIT, GPU_STAGES };
struct gpu_words {
    uint32_t *words;
    size_t bytes;
};
/* Decompresses a module. Callable from any thread. Free the words with kiln_free. */
int gpu_code_unpack(const struct gpu *gpu, const struct gpu_code *code, struct gpu_words *words,
                    struct kiln_error *error);
/* kept.c */
struct gpu_kept {
    VkPipelineCache cache; /* cache with which a kernel is created; VK_NULL_HANDLE: none */
    char key[KILN_KERNEL_KEY + 1];
    bool found;
};
/* Finds the identity of device and driver that kept kernels must match. */
void gpu_kept_identify(struct gpu *gpu);
/* Open the store before a kernel is created, and close it afterwards; `made`: creation succeeded. */
void gpu_kept_open(struct gpu *gpu, const struct gpu_kernel_params *params, const struct gpu_words words[GPU_STAGES],
                   struct gpu_kept *kept);
void gpu_kept_close(struct gpu *gpu, struct gpu_kept *kept, bool made);
/* times.c: gpu->times, NULL if steps are not timed one by one; then only the first two of these functions may be
 * called. */
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
/* Checks the number of threads: KILN_BUG, with the numbers, if the device cannot start so many at once. */
int gpu_kernel_fits(const struct gpu_kernel *kernel, const struct gpu_step *step, const struct gpu *gpu,
                    struct kiln_error *error);

#endif
