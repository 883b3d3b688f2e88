#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "worker/backend/vulkan/gpu/private.h"
#include "worker/base/memory.h"

bool gpu_has_extension(VkPhysicalDevice physical, const char *name)
{
    uint32_t count = 0;
    bool found = false;
    VkExtensionProperties *list = NULL;
    if (vkEnumerateDeviceExtensionProperties(physical, NULL, &count, NULL) != VK_SUCCESS ||
        kiln_allocate(&list, count, sizeof *list, "names of extensions", NULL) != KILN_OK)
        return false;
    if (vkEnumerateDeviceExtensionProperties(physical, NULL, &count, list) == VK_SUCCESS)
        for (uint32_t i = 0; i < count && !found; i++)
            found = strcmp(list[i].extensionName, name) == 0;
    kiln_free(&list);
    return found;
}

static void describe_driver(VkPhysicalDevice physical, struct kiln_device *about)
{
    VkPhysicalDeviceVulkan12Properties v12 = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_PROPERTIES};
    VkPhysicalDeviceVulkan11Properties v11 = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_1_PROPERTIES,
                                              .pNext = &v12};
    VkPhysicalDeviceProperties2 properties = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2, .pNext = &v11};
    vkGetPhysicalDeviceProperties2(physical, &properties);
    memcpy(about->uuid, v11.deviceUUID, sizeof about->uuid);
    about->subgroup = v11.subgroupSize;
    (void)snprintf(about->driver, sizeof about->driver, "%.63s %.63s", v12.driverName, v12.driverInfo);
}

static void describe_memory(VkPhysicalDevice physical, struct kiln_device *about)
{
    const bool known = gpu_has_extension(physical, VK_EXT_MEMORY_BUDGET_EXTENSION_NAME);
    VkPhysicalDeviceMemoryBudgetPropertiesEXT budget = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_MEMORY_BUDGET_PROPERTIES_EXT};
    VkPhysicalDeviceMemoryProperties2 memory = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_MEMORY_PROPERTIES_2,
                                                .pNext = known ? &budget : NULL};
    vkGetPhysicalDeviceMemoryProperties2(physical, &memory);
    for (uint32_t i = 0; i < memory.memoryProperties.memoryHeapCount; i++) {
        const VkMemoryHeap *heap = &memory.memoryProperties.memoryHeaps[i];
        if ((heap->flags & VK_MEMORY_HEAP_DEVICE_LOCAL_BIT) == 0 || heap->size <= about->memory)
            continue;
        about->memory = heap->size;
        about->budget = heap->size / 5 * 4;
        if (known)
            about->budget = budget.heapBudget[i] > budget.heapUsage[i] ? budget.heapBudget[i] - budget.heapUsage[i] : 0;
    }
}

static void lack(struct kiln_device *about, bool has, const char *what)
{
    const size_t length = strlen(about->lacks);
    if (!has)
        (void)snprintf(about->lacks + length, sizeof about->lacks - length, "%s%s", length > 0 ? ", " : "", what);
}

/* Whether the device has ray-tracing pipelines, which our shaders use; ray queries are not needed. */
static bool offers_ray_tracing(VkPhysicalDevice physical)
{
    if (!gpu_has_extension(physical, VK_KHR_RAY_TRACING_PIPELINE_EXTENSION_NAME) ||
        !gpu_has_extension(physical, VK_KHR_ACCELERATION_STRUCTURE_EXTENSION_NAME) ||
        !gpu_has_extension(physical, VK_KHR_DEFERRED_HOST_OPERATIONS_EXTENSION_NAME))
        return false;
    VkPhysicalDeviceRayTracingPipelineFeaturesKHR pipeline = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_RAY_TRACING_PIPELINE_FEATURES_KHR};
    VkPhysicalDeviceAccelerationStructureFeaturesKHR structure = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_ACCELERATION_STRUCTURE_FEATURES_KHR, .pNext = &pipeline};
    VkPhysicalDeviceFeatures2 features = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2, .pNext = &structure};
    vkGetPhysicalDeviceFeatures2(physical, &features);
    return pipeline.rayTracingPipeline && structure.accelerationStructure;
}

static bool has_compute_queue(VkPhysicalDevice physical)
{
    VkQueueFamilyProperties families[16];
    uint32_t count = sizeof families / sizeof *families;
    vkGetPhysicalDeviceQueueFamilyProperties(physical, &count, families);
    for (uint32_t i = 0; i < count; i++)
        if ((families[i].queueFlags & VK_QUEUE_COMPUTE_BIT) != 0)
            return true;
    return false;
}

static void judge(VkPhysicalDevice physical, struct kiln_device *about)
{
    VkPhysicalDeviceVulkan12Features v12 = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES};
    VkPhysicalDeviceFeatures2 features = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_FEATURES_2, .pNext = &v12};
    vkGetPhysicalDeviceFeatures2(physical, &features);
    lack(about, features.features.shaderInt64, "shaderInt64");
    lack(about, v12.bufferDeviceAddress, "bufferDeviceAddress");
    lack(about, v12.scalarBlockLayout, "scalarBlockLayout");
    lack(about, has_compute_queue(physical), "a queue for compute");
    about->float64 = features.features.shaderFloat64;
    about->ray_tracing = offers_ray_tracing(physical);
}

static void describe(VkPhysicalDevice physical, struct kiln_device *about)
{
    VkPhysicalDeviceProperties properties;
    vkGetPhysicalDeviceProperties(physical, &properties);
    *about = (struct kiln_device){.api_version = properties.apiVersion,
                                  .software = properties.deviceType == VK_PHYSICAL_DEVICE_TYPE_CPU};
    (void)snprintf(about->name, sizeof about->name, "%.127s", properties.deviceName);
    if (properties.apiVersion >= VK_API_VERSION_1_2) {
        describe_driver(physical, about);
        describe_memory(physical, about);
        judge(physical, about);
    } else {
        lack(about, false, "Vulkan 1.2");
    }
    about->fit = about->lacks[0] == '\0';
}

static int compare_devices(const void *a, const void *b)
{
    const struct gpu_found *x = a, *y = b;
    if (x->about.software != y->about.software)
        return x->about.software ? 1 : -1;
    return memcmp(x->about.uuid, y->about.uuid, sizeof x->about.uuid);
}

int gpu_find(VkInstance instance, struct gpu_found **found, size_t *count, struct kiln_error *error)
{
    enum { MOST = 256 };
    VkPhysicalDevice devices[MOST];
    uint32_t n = instance != VK_NULL_HANDLE ? MOST : 0;
    *count = 0;
    const VkResult result = n > 0 ? vkEnumeratePhysicalDevices(instance, &n, devices) : VK_SUCCESS;
    if (result != VK_SUCCESS && result != VK_INCOMPLETE)
        n = 0; /* drivers without a device answer so */
    const int status = kiln_allocate(found, n, sizeof **found, "the list of devices", error);
    if (status != KILN_OK)
        return status;
    for (uint32_t i = 0; i < n; i++) {
        (*found)[i].physical = devices[i];
        describe(devices[i], &(*found)[i].about);
    }
    qsort(*found, n, sizeof **found, compare_devices);
    for (uint32_t i = 0; i < n; i++)
        (*found)[i].about.index = i;
    *count = n;
    return KILN_OK;
}

int gpu_list(struct kiln_device *list, size_t room, size_t *count, struct kiln_error *error)
{
    VkInstance instance = VK_NULL_HANDLE;
    struct gpu_found *found = NULL;
    *count = 0;
    int status;
    KILN_TRY(gpu_instance_create(NULL, false, &instance, error));
    KILN_TRY(gpu_find(instance, &found, count, error));
    for (size_t i = 0; i < *count && i < room; i++)
        list[i] = found[i].about;
end:
    kiln_free(&found);
    if (instance != VK_NULL_HANDLE)
        vkDestroyInstance(instance, NULL);
    return status;
}
