/* Cache of compiled kernels between runs (worker/base/kernel_store.h): a VkPipelineCache for each kernel. Nothing here
 * is an error: a kernel that is not in the cache is compiled. So no call here is in GPU_TRY. */
#include <stdio.h>
#include <string.h>

#include <xxhash.h>

#include "worker/backend/vulkan/gpu/private.h"
#include "worker/base/memory.h"

/* Hashes all that a compiled kernel depends on. Properties are hashed field by field, without padding. */
static XXH128_hash_t hash_of(const struct gpu *gpu, const struct gpu_kernel_params *k,
                             const struct gpu_words words[GPU_STAGES])
{
    struct {
        const void *words;
        size_t bytes;
    } parts[GPU_STAGES + 1] = {[GPU_STAGES] = {k->constants, k->constant_count * sizeof *k->constants}};
    for (uint32_t i = 0; i < GPU_STAGES; i++) {
        parts[i].words = words[i].words;
        parts[i].bytes = words[i].bytes;
    }
    XXH128_hash_t hash = gpu->identity;
    for (size_t i = 0; i < sizeof parts / sizeof *parts; i++) { /* each with its length, by the seed */
        const XXH128_hash_t own = XXH3_128bits_withSeed(parts[i].words, parts[i].bytes, hash.low64);
        hash.low64 = own.low64;
        hash.high64 = own.high64 ^ (hash.high64 * 0x9e3779b97f4a7c15u + parts[i].bytes);
    }
    return hash;
}

/* Identifies the device by its model: kernels compiled on one device serve all equal ones. */
void gpu_kept_identify(struct gpu *gpu)
{
    VkPhysicalDeviceVulkan12Properties v12 = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_PROPERTIES};
    VkPhysicalDeviceProperties2 all = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2, .pNext = &v12};
    vkGetPhysicalDeviceProperties2(gpu->physical, &all);
    const VkPhysicalDeviceProperties *p = &all.properties;
    char text[1024] = {0};
    (void)snprintf(text, sizeof text, "%u %u %u %d %u %s %s", p->vendorID, p->deviceID, p->driverVersion,
                   (int)v12.driverID, gpu->about.ray_tracing, v12.driverName, v12.driverInfo);
    memcpy(text + sizeof text - VK_UUID_SIZE, p->pipelineCacheUUID, VK_UUID_SIZE);
    gpu->identity = XXH3_128bits(text, sizeof text);
    gpu->vendor = p->vendorID;
    gpu->device_id = p->deviceID;
    memcpy(gpu->cache_uuid, p->pipelineCacheUUID, VK_UUID_SIZE);
}

/* Whether the data's header, written by the driver, names this device and driver. */
static bool is_ours(const struct gpu *gpu, const void *bytes, size_t size)
{
    VkPipelineCacheHeaderVersionOne header;
    if (bytes == NULL || size < sizeof header)
        return false;
    memcpy(&header, bytes, sizeof header);
    return header.headerSize >= sizeof header && header.headerSize <= size &&
           header.headerVersion == VK_PIPELINE_CACHE_HEADER_VERSION_ONE && header.vendorID == gpu->vendor &&
           header.deviceID == gpu->device_id && memcmp(header.pipelineCacheUUID, gpu->cache_uuid, VK_UUID_SIZE) == 0;
}

static bool create_cache(const struct gpu *gpu, struct gpu_kept *kept, const void *bytes, size_t size)
{
    const VkPipelineCacheCreateInfo info = {
        .sType = VK_STRUCTURE_TYPE_PIPELINE_CACHE_CREATE_INFO, .initialDataSize = size, .pInitialData = bytes};
    if (vkCreatePipelineCache(gpu->device, &info, NULL, &kept->cache) == VK_SUCCESS)
        return true;
    kept->cache = VK_NULL_HANDLE;
    return false;
}

void gpu_kept_open(struct gpu *gpu, const struct gpu_kernel_params *params, const struct gpu_words words[GPU_STAGES],
                   struct gpu_kept *kept)
{
    *kept = (struct gpu_kept){.cache = VK_NULL_HANDLE};
    if (gpu->kernels.load == NULL)
        return;
    const XXH128_hash_t hash = hash_of(gpu, params, words);
    (void)snprintf(kept->key, sizeof kept->key, "%016llx%016llx", (unsigned long long)hash.high64,
                   (unsigned long long)hash.low64);
    size_t size = 0;
    void *bytes = gpu->kernels.load(gpu->kernels.place, kept->key, &size);
    kept->found = is_ours(gpu, bytes, size) && create_cache(gpu, kept, bytes, size);
    if (!kept->found)
        (void)create_cache(gpu, kept, NULL, 0);
    kiln_free(&bytes);
}

/* Stores the driver's present data of the kernel. */
static void keep(const struct gpu *gpu, const struct gpu_kept *kept)
{
    size_t size = 0;
    void *bytes = NULL;
    if (vkGetPipelineCacheData(gpu->device, kept->cache, &size, NULL) == VK_SUCCESS && size > 0 &&
        kiln_allocate(&bytes, size, 1, "a kernel", NULL) == KILN_OK &&
        vkGetPipelineCacheData(gpu->device, kept->cache, &size, bytes) == VK_SUCCESS && is_ours(gpu, bytes, size))
        gpu->kernels.keep(gpu->kernels.place, kept->key, bytes, size);
    kiln_free(&bytes);
}

void gpu_kept_close(struct gpu *gpu, struct gpu_kept *kept, bool made)
{
    if (made)
        (void)atomic_fetch_add(kept->found ? &gpu->kernels_found : &gpu->kernels_made, 1);
    if (kept->cache == VK_NULL_HANDLE)
        return;
    if (made && !kept->found)
        keep(gpu, kept);
    vkDestroyPipelineCache(gpu->device, kept->cache, NULL);
}

void gpu_kernels_count(const struct gpu *gpu, uint64_t *found, uint64_t *made)
{
    *found = atomic_load(&gpu->kernels_found);
    *made = atomic_load(&gpu->kernels_made);
}
