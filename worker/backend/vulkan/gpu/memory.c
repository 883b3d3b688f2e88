#include <assert.h>
#include <string.h>

#include "worker/backend/vulkan/gpu/private.h"
#include "worker/base/memory.h"

struct gpu_buffer_memory {
    VkBuffer buffer;
    VkDeviceMemory memory;
    struct gpu_guarded *guarded; /* NULL: it is not */
    uint64_t counted;            /* bytes of the device's own memory */
};

/* ---- how much there is ---- */

static uint64_t minus(uint64_t a, uint64_t b) { return a > b ? a - b : 0; }

/* Returns the largest memory, in bytes, for this process: its share of the device. */
static uint64_t memory_allowed(const struct gpu *gpu)
{
    VkPhysicalDeviceMemoryBudgetPropertiesEXT budget = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_MEMORY_BUDGET_PROPERTIES_EXT};
    VkPhysicalDeviceMemoryProperties2 memory = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_MEMORY_PROPERTIES_2,
                                                .pNext = &budget};
    const uint64_t heap = gpu->about.memory / gpu->sharers;
    uint64_t allowed = heap / 5 * 4;
    if (gpu->knows_budget) {
        vkGetPhysicalDeviceMemoryProperties2(gpu->physical, &memory);
        allowed = gpu->memory_used + minus(budget.heapBudget[gpu->heap], budget.heapUsage[gpu->heap]);
        if (gpu->sharers > 1 && allowed > heap / 10 * 9) /* the other processes may not have allocated theirs yet */
            allowed = heap / 10 * 9;
    }
    return gpu->memory_limit > 0 && gpu->memory_limit < allowed ? gpu->memory_limit : allowed;
}

uint64_t gpu_memory_left(const struct gpu *gpu) { return minus(memory_allowed(gpu), gpu->memory_used); }

uint64_t gpu_memory_used(const struct gpu *gpu) { return gpu->memory_used; }

/* ---- buffers ---- */

/* Finds the first memory type with all `wanted` flags and no `unwanted` ones, among those in `bits`. */
static bool find_type(const struct gpu *gpu, uint32_t bits, VkMemoryPropertyFlags wanted,
                      VkMemoryPropertyFlags unwanted, uint32_t *type)
{
    for (uint32_t i = 0; i < gpu->memory.memoryTypeCount; i++) {
        const VkMemoryPropertyFlags flags = gpu->memory.memoryTypes[i].propertyFlags;
        if ((bits >> i & 1) != 0 && (flags & wanted) == wanted && (flags & unwanted) == 0) {
            *type = i;
            return true;
        }
    }
    return false;
}

static bool choose_type(const struct gpu *gpu, uint32_t bits, enum gpu_memory memory, uint32_t *type)
{
    const VkMemoryPropertyFlags mapped = VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;
    const VkMemoryPropertyFlags local = VK_MEMORY_PROPERTY_DEVICE_LOCAL_BIT,
                                cached = VK_MEMORY_PROPERTY_HOST_CACHED_BIT;
    if (memory == GPU_DEVICE)
        return find_type(gpu, bits, local, VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT, type) ||
               find_type(gpu, bits, local, 0, type);
    return find_type(gpu, bits, mapped | cached, local, type) || find_type(gpu, bits, mapped | cached, 0, type) ||
           find_type(gpu, bits, mapped, 0, type);
}

static VkBufferUsageFlags usage_of(const struct gpu *gpu)
{
    const VkBufferUsageFlags any = VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | VK_BUFFER_USAGE_TRANSFER_SRC_BIT |
                                   VK_BUFFER_USAGE_TRANSFER_DST_BIT | VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT;
    const VkBufferUsageFlags tracing = VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_BUILD_INPUT_READ_ONLY_BIT_KHR |
                                       VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_STORAGE_BIT_KHR |
                                       VK_BUFFER_USAGE_SHADER_BINDING_TABLE_BIT_KHR;
    return gpu->about.ray_tracing ? any | tracing : any;
}

static int check_room(struct gpu *gpu, uint64_t size, const char *what, struct kiln_error *error)
{
    const uint64_t left = gpu_memory_left(gpu);
    if (size <= left)
        return KILN_OK;
    gpu->short_of_memory = true;
    return kiln_fail(
        error, KILN_NO_DEVICE,
        "%s: %s takes %.1f MiB of the device's memory, and %.1f MiB are left of %.1f MiB that this process may use; "
        "bake on more ranks, with fewer texels, or with --backend embree",
        gpu->about.name, what, (double)size / 0x1p20, (double)left / 0x1p20,
        (double)(left + gpu->memory_used) / 0x1p20);
}

static int allocate_memory(struct gpu *gpu, struct gpu_buffer *b, enum gpu_memory memory, const char *what,
                           struct kiln_error *error)
{
    VkMemoryRequirements needs;
    uint32_t type = 0;
    vkGetBufferMemoryRequirements(gpu->device, b->memory->buffer, &needs);
    if (!choose_type(gpu, needs.memoryTypeBits, memory, &type))
        return kiln_fail(error, KILN_NO_DEVICE, "%s has no memory of the kind that %s needs", gpu->about.name, what);
    const bool own = gpu->memory.memoryTypes[type].heapIndex == gpu->heap;
    const int status = own ? check_room(gpu, needs.size, what, error) : KILN_OK;
    if (status != KILN_OK)
        return status;
    const VkMemoryAllocateFlagsInfo flags = {.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_FLAGS_INFO,
                                             .flags = VK_MEMORY_ALLOCATE_DEVICE_ADDRESS_BIT};
    const VkMemoryAllocateInfo info = {.sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO,
                                       .pNext = &flags,
                                       .allocationSize = gpu_guard_memory_size(gpu, needs.size),
                                       .memoryTypeIndex = type};
    const VkResult result = GPU_TRY(gpu, vkAllocateMemory(gpu->device, &info, NULL, &b->memory->memory));
    if (result != VK_SUCCESS)
        return gpu_failure(gpu, result, error,
                           "cannot allocate %.1f MiB for %s (the driver vouches for %.1f MiB in one piece)",
                           (double)needs.size / 0x1p20, what, (double)gpu->largest_allocation / 0x1p20);
    b->memory->counted = own ? needs.size : 0;
    gpu->memory_used += b->memory->counted;
    return KILN_OK;
}

static int bind_memory(struct gpu *gpu, struct gpu_buffer *b, enum gpu_memory memory, const char *what,
                       struct kiln_error *error)
{
    const struct gpu_guarded *guarded = b->memory->guarded;
    VkResult result = GPU_TRY(gpu, vkBindBufferMemory(gpu->device, b->memory->buffer, b->memory->memory,
                                                      guarded != NULL ? guarded->offset : 0));
    if (result == VK_SUCCESS && memory == GPU_HOST && guarded == NULL)
        result = GPU_TRY(gpu, vkMapMemory(gpu->device, b->memory->memory, 0, VK_WHOLE_SIZE, 0, &b->mapped));
    if (result != VK_SUCCESS)
        return gpu_failure(gpu, result, error, "cannot use the %zu bytes allocated for %s", b->size, what);
    const VkBufferDeviceAddressInfo info = {.sType = VK_STRUCTURE_TYPE_BUFFER_DEVICE_ADDRESS_INFO,
                                            .buffer = b->memory->buffer};
    b->address = vkGetBufferDeviceAddress(gpu->device, &info) + gpu_buffer_skip(b);
    assert(b->address % 64 == 0 || guarded != NULL);
    if (guarded != NULL && b->address != (uintptr_t)guarded->start)
        return kiln_fail(error, KILN_NO_DEVICE,
                         "%s does not reach memory by the process's own addresses: its buffers cannot be guarded",
                         gpu->about.name);
    if (guarded != NULL && memory == GPU_HOST)
        b->mapped = guarded->start;
    gpu_name(gpu, VK_OBJECT_TYPE_BUFFER, (uint64_t)b->memory->buffer, what);
    return KILN_OK;
}

static int create_vk_buffer(struct gpu *gpu, struct gpu_buffer *b, const char *what, struct kiln_error *error)
{
    const uint32_t families[2] = {gpu->queue_family, gpu->copy_family};
    const bool shared = gpu->copy_family != gpu->queue_family;
    const VkBufferCreateInfo info = {.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO,
                                     .size = gpu_guard_buffer_size(gpu, b->size),
                                     .usage = usage_of(gpu),
                                     .sharingMode = shared ? VK_SHARING_MODE_CONCURRENT : VK_SHARING_MODE_EXCLUSIVE,
                                     .queueFamilyIndexCount = shared ? 2 : 0,
                                     .pQueueFamilyIndices = families};
    const VkResult result = GPU_TRY(gpu, vkCreateBuffer(gpu->device, &info, NULL, &b->memory->buffer));
    return result == VK_SUCCESS
               ? KILN_OK
               : gpu_failure(gpu, result, error, "cannot create a buffer of %zu bytes for %s", b->size, what);
}

int gpu_buffer_create(struct gpu *gpu, struct gpu_buffer *buffer, size_t size, enum gpu_memory memory, const char *what,
                      struct kiln_error *error)
{
    *buffer = (struct gpu_buffer){.size = size};
    if (size == 0)
        return KILN_OK;
    int status;
    KILN_TRY(kiln_allocate(&buffer->memory, 1, sizeof *buffer->memory, what, error));

    /* checked first, so that no driver is asked for an absurd size */
    KILN_TRY(check_room(gpu, memory == GPU_DEVICE ? size : 0, what, error));
    KILN_TRY(create_vk_buffer(gpu, buffer, what, error));
    KILN_TRY(allocate_memory(gpu, buffer, memory, what, error));
    if (gpu->guard != NULL)
        KILN_TRY(gpu_guard_take(gpu, buffer->memory->memory, size, what, &buffer->memory->guarded, error));
    KILN_TRY(bind_memory(gpu, buffer, memory, what, error));
end:
    if (status == KILN_OK)
        gpu->short_of_memory = false;
    else
        gpu_buffer_destroy(gpu, buffer);
    return status;
}

void gpu_buffer_destroy(struct gpu *gpu, struct gpu_buffer *buffer)
{
    struct gpu_buffer_memory *m = buffer->memory;
    if (m != NULL) {
        if (gpu_settle(gpu)) {
            vkDestroyBuffer(gpu->device, m->buffer, NULL);
            if (m->guarded != NULL)
                gpu_guard_retire(m->guarded);
            else
                vkFreeMemory(gpu->device, m->memory, NULL);
        }
        gpu->memory_used -= m->counted;
        kiln_free(&buffer->memory);
    }
    *buffer = (struct gpu_buffer){0};
}

VkBuffer gpu_vk_buffer(const struct gpu_buffer *buffer) { return buffer->memory->buffer; }

size_t gpu_buffer_skip(const struct gpu_buffer *buffer)
{
    return buffer->memory->guarded != NULL ? buffer->memory->guarded->skip : 0;
}

/* ---- to and from the device ---- */

enum { PART = 1 << 20, MOST_COPIERS = 8 };

int gpu_staging_create(struct gpu *gpu, struct kiln_error *error)
{
    int status = KILN_OK;
    for (int i = 0; i < GPU_STAGING_PIECES && status == KILN_OK; i++)
        status = gpu_buffer_create(gpu, &gpu->staging[i], GPU_STAGING_BYTES, GPU_HOST, "staging", error);
    return status;
}

/* Submits a copy. `alone`: it need not wait for kernels. */
static int submit_copy(struct gpu *gpu, struct gpu_slot *slot, const struct gpu_step *step, bool alone,
                       struct kiln_error *error)
{
    const int status = alone ? gpu_slot_begin_copies(gpu, slot, error) : gpu_slot_begin(gpu, slot, error);
    if (status != KILN_OK)
        return status;
    gpu_copy_record(gpu, alone ? slot->copies.buffer : slot->kernels.buffer, step);
    return alone ? gpu_slot_end_copies(gpu, slot, error) : gpu_slot_end(gpu, slot, error);
}

static size_t piece_size(size_t size, size_t at)
{
    return size - at < GPU_STAGING_BYTES ? size - at : (size_t)GPU_STAGING_BYTES;
}

/* Waits for all pieces under way, whatever the status so far. */
static int drain(struct gpu *gpu, int status, struct kiln_error *error)
{
    for (int i = 0; i < GPU_STAGING_PIECES; i++) {
        const int result = gpu_slot_wait(gpu, &gpu->slots[GPU_SLOTS + i], NULL, status == KILN_OK ? error : NULL);
        status = status == KILN_OK ? result : status;
    }
    return status;
}

/* Copies by several threads: a single one is much slower than a device's transfers. */
static void copy_by_threads(const struct gpu *gpu, char *to, const char *from, size_t size)
{
    const size_t whole = size / PART, parts = whole > 0 ? whole : 1;
    const int threads = gpu->threads > 1 ? (int)gpu->threads : 1;
#pragma omp parallel for num_threads(threads < MOST_COPIERS ? threads : MOST_COPIERS) if (parts > 1)
    for (size_t i = 0; i < parts; i++)
        memcpy(to + i * PART, from + i * PART, i + 1 < parts ? PART : size - i * PART);
}

static int upload(struct gpu *gpu, const struct gpu_buffer *buffer, size_t offset, const void *data, size_t size,
                  bool alone, struct kiln_error *error)
{
    int status = KILN_OK;
    assert(offset <= buffer->size && size <= buffer->size - offset);
    for (size_t at = 0, i = 0; at < size && status == KILN_OK; at += piece_size(size, at), i++) {
        const size_t k = i % GPU_STAGING_PIECES, n = piece_size(size, at);
        struct gpu_slot *slot = &gpu->slots[GPU_SLOTS + k];
        status = gpu_slot_wait(gpu, slot, NULL, error);
        if (status != KILN_OK)
            break;
        copy_by_threads(gpu, gpu->staging[k].mapped, (const char *)data + at, n);
        const struct gpu_step step = {.from = &gpu->staging[k], .to = buffer, .to_offset = offset + at, .size = n};
        status = submit_copy(gpu, slot, &step, alone, error);
    }
    return drain(gpu, status, error);
}

int gpu_upload(struct gpu *gpu, const struct gpu_buffer *buffer, size_t offset, const void *data, size_t size,
               struct kiln_error *error)
{
    return upload(gpu, buffer, offset, data, size, false, error);
}

int gpu_fill(struct gpu *gpu, const struct gpu_buffer *buffer, size_t offset, const void *data, size_t size,
             struct kiln_error *error)
{
    return upload(gpu, buffer, offset, data, size, true, error);
}

/* Downloads in pieces: while one piece is copied from the staging memory, the next one is transferred. */
int gpu_download(struct gpu *gpu, const struct gpu_buffer *buffer, size_t offset, void *data, size_t size,
                 struct kiln_error *error)
{
    int status = KILN_OK;
    assert(offset <= buffer->size && size <= buffer->size - offset);
    const size_t pieces = (size + GPU_STAGING_BYTES - 1) / GPU_STAGING_BYTES;
    for (size_t i = 0; i <= pieces && status == KILN_OK && pieces > 0; i++) {
        const size_t k = i % GPU_STAGING_PIECES, at = i * GPU_STAGING_BYTES;
        const struct gpu_step step = {.from = buffer,
                                      .to = &gpu->staging[k],
                                      .from_offset = offset + at,
                                      .size = i < pieces ? piece_size(size, at) : 0};
        if (i < pieces)
            status = submit_copy(gpu, &gpu->slots[GPU_SLOTS + k], &step, false, error);
        if (i == 0 || status != KILN_OK)
            continue;
        const size_t last = (i - 1) % GPU_STAGING_PIECES;
        status = gpu_slot_wait(gpu, &gpu->slots[GPU_SLOTS + last], NULL, error);
        if (status == KILN_OK)
            copy_by_threads(gpu, (char *)data + at - GPU_STAGING_BYTES, gpu->staging[last].mapped,
                            piece_size(size, at - GPU_STAGING_BYTES));
    }
    return drain(gpu, status, error);
}

int gpu_buffer_of(struct gpu *gpu, struct gpu_buffer *buffer, const void *data, size_t size, const char *what,
                  struct kiln_error *error)
{
    int status = gpu_buffer_create(gpu, buffer, size, GPU_DEVICE, what, error);
    if (status == KILN_OK)
        status = gpu_fill(gpu, buffer, 0, data, size, error);
    if (status != KILN_OK)
        gpu_buffer_destroy(gpu, buffer);
    return status;
}
