#include <assert.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "worker/backend/vulkan/gpu/private.h"
#include "worker/base/memory.h"

enum { MOST_EXTENSIONS = 8 };
/* Other flags that a queue for copies may have. Queues with still other flags have other work, such as video. */
enum { MAY_COPY_TOO = VK_QUEUE_SPARSE_BINDING_BIT | VK_QUEUE_PROTECTED_BIT };

/* ---- which device ---- */

/* Lists the devices found: "none" or "0 NVIDIA X; 1 llvmpipe lacks y". */
static void list_found(const struct gpu_found *found, size_t count, char *text, size_t size)
{
    size_t length = 0;
    (void)snprintf(text, size, "none");
    for (size_t i = 0; i < count && length < size; i++) {
        const struct kiln_device *a = &found[i].about;
        const int n = snprintf(text + length, size - length, "%s%zu %s%s%s", i > 0 ? "; " : "", i, a->name,
                               a->fit ? "" : " lacks ", a->lacks);
        length += n > 0 ? (size_t)n : 0;
    }
}

/* Chooses the local_rank-th suitable device in turn, among hardware devices if there are any; writes the number of
 * ranks that share it. */
static const struct gpu_found *take_turn(const struct gpu_found *found, size_t count, const struct gpu_choice *choice,
                                         uint32_t *sharers)
{
    uint32_t real = 0, software = 0;
    for (size_t i = 0; i < count; i++)
        *(found[i].about.software ? &software : &real) += found[i].about.fit ? 1 : 0;
    const uint32_t candidates = real > 0 ? real : software, ranks = choice->local_ranks > 0 ? choice->local_ranks : 1;
    if (candidates == 0)
        return NULL;
    uint32_t turn = choice->local_rank % candidates;
    *sharers = (ranks - turn + candidates - 1) / candidates;
    for (size_t i = 0; i < count; i++)
        if (found[i].about.fit && found[i].about.software == (real == 0) && turn-- == 0)
            return &found[i];
    return NULL;
}

static int choose(struct gpu *gpu, const struct gpu_choice *choice, struct kiln_error *error)
{
    char text[1024];
    struct gpu_found *found = NULL;
    const struct gpu_found *one = NULL;
    size_t count = 0;
    int status = gpu_find(gpu->instance, &found, &count, error);
    if (status != KILN_OK)
        return status;
    list_found(found, count, text, sizeof text);
    gpu->sharers = choice->local_ranks > 0 ? choice->local_ranks : 1;
    if (choice->device < 0)
        one = take_turn(found, count, choice, &gpu->sharers);
    else if ((size_t)choice->device < count && found[choice->device].about.fit)
        one = &found[choice->device];
    if (one == NULL && choice->device < 0)
        status = kiln_fail(error, KILN_NO_DEVICE, "no Vulkan device here is fit for kiln; found: %s", text);
    else if (one == NULL)
        status = kiln_fail(error, KILN_NO_DEVICE, "there is no fit Vulkan device %d here; found: %s",
                           (int)choice->device, text);
    if (one != NULL) {
        gpu->physical = one->physical;
        gpu->about = one->about;
        gpu->about.ray_tracing = one->about.ray_tracing && !choice->compute_only;
        gpu->about.float64 = one->about.float64 && !(choice->faults != NULL && choice->faults->wanted.floats);
    }
    kiln_free(&found);
    return status;
}

/* ---- the device ---- */

static void choose_queue(struct gpu *gpu, double *tick_bits)
{
    VkQueueFamilyProperties families[16];
    uint32_t count = sizeof families / sizeof *families;
    vkGetPhysicalDeviceQueueFamilyProperties(gpu->physical, &count, families);
    for (uint32_t i = count; i-- > 0;)
        if ((families[i].queueFlags & VK_QUEUE_COMPUTE_BIT) != 0) {
            gpu->queue_family = i; /* the first of them */
            *tick_bits = families[i].timestampValidBits;
        }
    gpu->copy_family = gpu->queue_family;
    for (uint32_t i = count; i-- > 0;)
        if ((families[i].queueFlags & ~(VkQueueFlags)MAY_COPY_TOO) == VK_QUEUE_TRANSFER_BIT)
            gpu->copy_family = i;
}

static void learn_properties(struct gpu *gpu)
{
    gpu->ray_tracing.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_TRACING_PIPELINE_PROPERTIES_KHR;
    VkPhysicalDeviceMaintenance3Properties largest = {.sType =
                                                          VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_MAINTENANCE_3_PROPERTIES,
                                                      .pNext = gpu->about.ray_tracing ? &gpu->ray_tracing : NULL};
    VkPhysicalDeviceProperties2 properties = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2,
                                              .pNext = &largest};
    vkGetPhysicalDeviceProperties2(gpu->physical, &properties);
    gpu->ray_tracing.pNext = NULL;
    gpu->limits = properties.properties.limits;
    gpu->largest_allocation = largest.maxMemoryAllocationSize;
    gpu->knows_budget = gpu_has_extension(gpu->physical, VK_EXT_MEMORY_BUDGET_EXTENSION_NAME);
    vkGetPhysicalDeviceMemoryProperties(gpu->physical, &gpu->memory);
    for (uint32_t i = gpu->memory.memoryHeapCount; i-- > 0;)
        if ((gpu->memory.memoryHeaps[i].flags & VK_MEMORY_HEAP_DEVICE_LOCAL_BIT) != 0 &&
            gpu->memory.memoryHeaps[i].size == gpu->about.memory)
            gpu->heap = i;
}

static uint32_t list_extensions(const struct gpu *gpu, const char *names[MOST_EXTENSIONS])
{
    uint32_t count = 0;
    if (gpu->knows_budget)
        names[count++] = VK_EXT_MEMORY_BUDGET_EXTENSION_NAME;
    if (gpu->about.ray_tracing) {
        names[count++] = VK_KHR_RAY_TRACING_PIPELINE_EXTENSION_NAME;
        names[count++] = VK_KHR_ACCELERATION_STRUCTURE_EXTENSION_NAME;
        names[count++] = VK_KHR_DEFERRED_HOST_OPERATIONS_EXTENSION_NAME;
    }
    return count;
}

static void load_extensions(struct gpu *gpu)
{
    if (!gpu->about.ray_tracing)
        return;
    struct gpu_extensions *e = &gpu->extensions;
    e->create_pipelines =
        (PFN_vkCreateRayTracingPipelinesKHR)vkGetDeviceProcAddr(gpu->device, "vkCreateRayTracingPipelinesKHR");
    e->group_handles = (PFN_vkGetRayTracingShaderGroupHandlesKHR)vkGetDeviceProcAddr(
        gpu->device, "vkGetRayTracingShaderGroupHandlesKHR");
    e->trace_rays = (PFN_vkCmdTraceRaysKHR)vkGetDeviceProcAddr(gpu->device, "vkCmdTraceRaysKHR");
}

static int create_device(struct gpu *gpu, struct kiln_error *error)
{
    const char *extensions[MOST_EXTENSIONS];
    const float priority = 1.0f;
    VkPhysicalDeviceRayTracingPipelineFeaturesKHR pipeline = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_TRACING_PIPELINE_FEATURES_KHR, .rayTracingPipeline = VK_TRUE};
    VkPhysicalDeviceAccelerationStructureFeaturesKHR structure = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_ACCELERATION_STRUCTURE_FEATURES_KHR,
        .pNext = &pipeline,
        .accelerationStructure = VK_TRUE};
    VkPhysicalDeviceVulkan12Features v12 = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES,
                                            .pNext = gpu->about.ray_tracing ? &structure : NULL,
                                            .bufferDeviceAddress = VK_TRUE,
                                            .scalarBlockLayout = VK_TRUE,
                                            .timelineSemaphore = VK_TRUE};
    const VkPhysicalDeviceFeatures2 features = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2,
        .pNext = &v12,
        .features = {.shaderInt64 = VK_TRUE, .shaderFloat64 = gpu->about.float64}};
    VkDeviceQueueCreateInfo queues[2] = {{.sType = VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO,
                                          .queueFamilyIndex = gpu->queue_family,
                                          .queueCount = 1,
                                          .pQueuePriorities = &priority}};
    queues[1] = queues[0];
    queues[1].queueFamilyIndex = gpu->copy_family;
    const VkDeviceCreateInfo info = {.sType = VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO,
                                     .pNext = &features,
                                     .queueCreateInfoCount = gpu->copy_family != gpu->queue_family ? 2 : 1,
                                     .pQueueCreateInfos = queues,
                                     .enabledExtensionCount = list_extensions(gpu, extensions),
                                     .ppEnabledExtensionNames = extensions};
    const VkResult result = GPU_TRY(gpu, vkCreateDevice(gpu->physical, &info, NULL, &gpu->device));
    if (result != VK_SUCCESS)
        return gpu_failure(gpu, result, error, "the device does not start");
    vkGetDeviceQueue(gpu->device, gpu->queue_family, 0, &gpu->queue);
    vkGetDeviceQueue(gpu->device, gpu->copy_family, 0, &gpu->copy_queue);
    load_extensions(gpu);
    return KILN_OK;
}

static int create_once(struct gpu **gpu, const struct gpu_choice *choice, struct kiln_error *error)
{
    double bits = 0.0;
    *gpu = NULL;
    int status;
    KILN_TRY(kiln_allocate(gpu, 1, sizeof **gpu, "a device", error));
    struct gpu *g = *gpu;
    g->faults = choice->faults;
    g->memory_limit = choice->memory_limit;
    g->kernels = choice->kernels;
    g->threads = choice->threads;
    g->slice_seconds = choice->slice_seconds > 0.0 ? choice->slice_seconds : 0.1;
    KILN_TRY(gpu_instance_create(g, choice->validation, &g->instance, error));
    KILN_TRY(choose(g, choice, error));
    KILN_TRY(gpu_guard_create(g, error));
    choose_queue(g, &bits);
    learn_properties(g);
    gpu_kept_identify(g);
    if (bits == 0.0) /* the queue has no clock */
        g->limits.timestampPeriod = 0.0f;
    KILN_TRY(create_device(g, error));
    KILN_TRY(gpu_layouts_create(g, error));
    gpu_times_create(g);
    KILN_TRY(gpu_slots_create(g, error));
    KILN_TRY(gpu_guard_start(g, error));
    KILN_TRY(gpu_staging_create(g, error));
end:
    return status;
}

int gpu_create(struct gpu **gpu, const struct gpu_choice *choice, struct kiln_error *error)
{
    enum { TRIES = 3 };
    int status = KILN_NO_DEVICE;
    bool again = true;
    struct kiln_error why;
    for (int i = 0; i < TRIES && again; i++) {
        status = create_once(gpu, choice, &why);
        again = status != KILN_OK && *gpu != NULL && ((*gpu)->lost || (*gpu)->short_of_memory);
        if (status != KILN_OK)
            gpu_destroy(gpu);
    }
    return status == KILN_OK ? KILN_OK : kiln_fail(error, status, "%s", why.message);
}

static void destroy_instance(struct gpu *g)
{
    const PFN_vkDestroyDebugUtilsMessengerEXT destroy_messenger =
        (PFN_vkDestroyDebugUtilsMessengerEXT)vkGetInstanceProcAddr(g->instance, "vkDestroyDebugUtilsMessengerEXT");
    if (g->messenger != VK_NULL_HANDLE)
        destroy_messenger(g->instance, g->messenger, NULL);
    vkDestroyInstance(g->instance, NULL);
}

void gpu_destroy(struct gpu **gpu)
{
    struct gpu *g = *gpu;
    if (g == NULL)
        return;
    if (g->device != VK_NULL_HANDLE && !g->hangs)
        (void)vkDeviceWaitIdle(g->device);
    for (int i = 0; i < GPU_STAGING_PIECES; i++)
        gpu_buffer_destroy(g, &g->staging[i]);
    gpu_guard_destroy(g);
    gpu_times_destroy(g);
    if (g->device != VK_NULL_HANDLE && !g->hangs) {
        gpu_slots_destroy(g);
        gpu_layouts_destroy(g);
        vkDestroyDevice(g->device, NULL);
    }
    if (g->instance != VK_NULL_HANDLE && !g->hangs)
        destroy_instance(g);
    kiln_free(&g->code_file);
    kiln_free(gpu);
}

const struct kiln_device *gpu_about(const struct gpu *gpu) { return &gpu->about; }

double gpu_slice(const struct gpu *gpu) { return gpu->slice_seconds; }

size_t gpu_messages(const struct gpu *gpu) { return atomic_load(&gpu->messages); }

VkDevice gpu_vk_device(const struct gpu *gpu) { return gpu->device; }

void gpu_name(const struct gpu *gpu, VkObjectType type, uint64_t handle, const char *name)
{
    const VkDebugUtilsObjectNameInfoEXT info = {.sType = VK_STRUCTURE_TYPE_DEBUG_UTILS_OBJECT_NAME_INFO_EXT,
                                                .objectType = type,
                                                .objectHandle = handle,
                                                .pObjectName = name};
    if (gpu->extensions.set_name != NULL)
        (void)gpu->extensions.set_name(gpu->device, &info);
}
