#include <assert.h>
#include <time.h>

#include "worker/backend/vulkan/gpu/private.h"

/* for one submission; a device that is not back by then is taken for lost */
#define PATIENCE_NANOSECONDS 600000000000ull

static double now(void)
{
    struct timespec t;
    (void)clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* ---- slots ---- */

static VkResult create_slot(struct gpu *gpu, struct gpu_slot *slot)
{
    const VkCommandPoolCreateInfo pool = {.sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO,
                                          .flags = VK_COMMAND_POOL_CREATE_TRANSIENT_BIT,
                                          .queueFamilyIndex = gpu->queue_family};
    VkResult result = GPU_TRY(gpu, vkCreateCommandPool(gpu->device, &pool, NULL, &slot->pool));
    const VkCommandBufferAllocateInfo commands = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO,
                                                  .commandPool = slot->pool,
                                                  .level = VK_COMMAND_BUFFER_LEVEL_PRIMARY,
                                                  .commandBufferCount = 1};
    const VkFenceCreateInfo fence = {.sType = VK_STRUCTURE_TYPE_FENCE_CREATE_INFO};
    const VkQueryPoolCreateInfo queries = {
        .sType = VK_STRUCTURE_TYPE_QUERY_POOL_CREATE_INFO, .queryType = VK_QUERY_TYPE_TIMESTAMP, .queryCount = 2};
    if (result == VK_SUCCESS)
        result = GPU_TRY(gpu, vkAllocateCommandBuffers(gpu->device, &commands, &slot->commands));
    if (result == VK_SUCCESS)
        result = GPU_TRY(gpu, vkCreateFence(gpu->device, &fence, NULL, &slot->fence));
    if (result == VK_SUCCESS)
        result = GPU_TRY(gpu, vkCreateQueryPool(gpu->device, &queries, NULL, &slot->queries));
    return result;
}

int gpu_slots_create(struct gpu *gpu, struct kiln_error *error)
{
    VkResult result = VK_SUCCESS;
    for (int i = 0; i < GPU_ALL_SLOTS && result == VK_SUCCESS; i++)
        result = create_slot(gpu, &gpu->slots[i]);
    return result == VK_SUCCESS ? KILN_OK : gpu_failure(gpu, result, error, "cannot create what submissions need");
}

void gpu_slots_destroy(struct gpu *gpu)
{
    for (int i = 0; i < GPU_ALL_SLOTS; i++) {
        vkDestroyQueryPool(gpu->device, gpu->slots[i].queries, NULL);
        vkDestroyFence(gpu->device, gpu->slots[i].fence, NULL);
        vkDestroyCommandPool(gpu->device, gpu->slots[i].pool, NULL); /* with its commands */
    }
}

bool gpu_settle(const struct gpu *gpu)
{
    bool under_way = false;
    for (int i = 0; i < GPU_ALL_SLOTS; i++)
        under_way |= gpu->slots[i].under_way;
    if (under_way && !gpu->hangs)
        (void)vkDeviceWaitIdle(gpu->device);
    return !gpu->hangs;
}

void gpu_barrier(VkCommandBuffer commands)
{
    const VkMemoryBarrier barrier = {.sType = VK_STRUCTURE_TYPE_MEMORY_BARRIER,
                                     .srcAccessMask = VK_ACCESS_MEMORY_WRITE_BIT,
                                     .dstAccessMask = VK_ACCESS_MEMORY_READ_BIT | VK_ACCESS_MEMORY_WRITE_BIT};
    vkCmdPipelineBarrier(commands, VK_PIPELINE_STAGE_ALL_COMMANDS_BIT,
                         VK_PIPELINE_STAGE_ALL_COMMANDS_BIT | VK_PIPELINE_STAGE_HOST_BIT, 0, 1, &barrier, 0, NULL, 0,
                         NULL);
}

/* Times are taken once all before them is done, so that what the slots add up to is never more than the time that
 * passed. */
int gpu_slot_begin(struct gpu *gpu, struct gpu_slot *slot, struct kiln_error *error)
{
    const VkCommandBufferBeginInfo info = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO,
                                           .flags = VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT};
    assert(!slot->under_way);
    VkResult result = GPU_TRY(gpu, vkResetCommandPool(gpu->device, slot->pool, 0));
    if (result == VK_SUCCESS)
        result = GPU_TRY(gpu, vkBeginCommandBuffer(slot->commands, &info));
    if (result != VK_SUCCESS)
        return gpu_failure(gpu, result, error, "cannot record commands");
    vkCmdResetQueryPool(slot->commands, slot->queries, 0, 2);
    gpu_barrier(slot->commands);
    if (gpu->limits.timestampPeriod > 0.0f)
        vkCmdWriteTimestamp(slot->commands, VK_PIPELINE_STAGE_BOTTOM_OF_PIPE_BIT, slot->queries, 0);
    return KILN_OK;
}

int gpu_slot_end(struct gpu *gpu, struct gpu_slot *slot, struct kiln_error *error)
{
    gpu_guard_mark(gpu, slot->commands, NULL);
    gpu_barrier(slot->commands);
    if (gpu->limits.timestampPeriod > 0.0f)
        vkCmdWriteTimestamp(slot->commands, VK_PIPELINE_STAGE_BOTTOM_OF_PIPE_BIT, slot->queries, 1);
    const VkSubmitInfo info = {
        .sType = VK_STRUCTURE_TYPE_SUBMIT_INFO, .commandBufferCount = 1, .pCommandBuffers = &slot->commands};
    VkResult result = GPU_TRY(gpu, vkEndCommandBuffer(slot->commands));
    if (result == VK_SUCCESS)
        result = GPU_TRY(gpu, vkResetFences(gpu->device, 1, &slot->fence));
    if (result == VK_SUCCESS)
        result = GPU_TRY(gpu, vkQueueSubmit(gpu->queue, 1, &info, slot->fence));
    if (result != VK_SUCCESS)
        return gpu_failure(gpu, result, error, "the device takes no commands");
    slot->under_way = true;
    return KILN_OK;
}

static VkResult read_clock(struct gpu *gpu, const struct gpu_slot *slot, double *seconds)
{
    uint64_t ticks[2] = {0, 0};
    *seconds = 0.0;
    if (gpu->limits.timestampPeriod <= 0.0f)
        return VK_SUCCESS;
    const VkResult result =
        GPU_TRY(gpu, vkGetQueryPoolResults(gpu->device, slot->queries, 0, 2, sizeof ticks, ticks, sizeof *ticks,
                                           VK_QUERY_RESULT_64_BIT | VK_QUERY_RESULT_WAIT_BIT));
    *seconds = ticks[1] > ticks[0] ? (double)(ticks[1] - ticks[0]) * (double)gpu->limits.timestampPeriod * 1e-9 : 0.0;
    return result;
}

int gpu_slot_wait(struct gpu *gpu, struct gpu_slot *slot, double *seconds, struct kiln_error *error)
{
    double took = 0.0;
    if (seconds != NULL)
        *seconds = 0.0;
    if (!slot->under_way)
        return KILN_OK;
    VkResult result = GPU_TRY(gpu, vkWaitForFences(gpu->device, 1, &slot->fence, VK_TRUE, PATIENCE_NANOSECONDS));
    if (result == VK_TIMEOUT)
        gpu->lost = gpu->hangs = true;
    if (result != VK_SUCCESS && result != VK_TIMEOUT)
        /* nothing of it may be under way when the slot or its buffers are used again */
        (void)vkDeviceWaitIdle(gpu->device);
    if (result == VK_SUCCESS)
        result = read_clock(gpu, slot, &took);
    slot->under_way = false;
    if (seconds != NULL)
        *seconds = took;
    return result == VK_SUCCESS ? KILN_OK : gpu_failure(gpu, result, error, "waiting for the device");
}

/* ---- submissions ---- */

static bool is_empty(const struct gpu_step *step)
{
    return step->kernel != NULL ? step->threads_x == 0 || step->threads_y == 0 : step->size == 0;
}

static void record_step(const struct gpu *gpu, VkCommandBuffer commands, const struct gpu_step *step)
{
    if (step->kernel != NULL) {
        gpu_kernel_record(step->kernel, commands, step, gpu);
        return;
    }
    const VkBufferCopy region = {.srcOffset = gpu_buffer_skip(step->from) + step->from_offset,
                                 .dstOffset = gpu_buffer_skip(step->to) + step->to_offset,
                                 .size = step->size};
    assert(step->from_offset + step->size <= step->from->size && step->to_offset + step->size <= step->to->size);
    gpu_guard_mark(gpu, commands, NULL);
    vkCmdCopyBuffer(commands, gpu_vk_buffer(step->from), gpu_vk_buffer(step->to), 1, &region);
}

int gpu_submit(struct gpu *gpu, uint32_t slot, const struct gpu_step *steps, size_t count, struct kiln_error *error)
{
    assert(slot < GPU_SLOTS);
    struct gpu_slot *s = &gpu->slots[slot];
    int status = KILN_OK;
    for (size_t i = 0; i < count && status == KILN_OK; i++)
        if (!is_empty(&steps[i]) && steps[i].kernel != NULL)
            status = gpu_kernel_fits(steps[i].kernel, &steps[i], gpu, error);
    if (status == KILN_OK)
        status = gpu_slot_begin(gpu, s, error);
    if (status != KILN_OK)
        return status;
    bool first = true;
    for (size_t i = 0; i < count; i++) {
        if (is_empty(&steps[i]))
            continue;
        if (!first && !steps[i].alongside)
            gpu_barrier(s->commands);
        first = false;
        record_step(gpu, s->commands, &steps[i]);
    }
    if (gpu->first_submission <= 0.0)
        gpu->first_submission = now();
    return gpu_slot_end(gpu, s, error);
}

int gpu_wait(struct gpu *gpu, uint32_t slot, double *seconds, struct kiln_error *error)
{
    double took = 0.0;
    assert(slot < GPU_SLOTS);
    const int status = gpu_slot_wait(gpu, &gpu->slots[slot], &took, error);
    gpu->busy += took;
    if (seconds != NULL)
        *seconds = took;
    return status;
}

static uint32_t free_slot(const struct gpu *gpu)
{
    uint32_t slot = 0;
    while (slot < GPU_SLOTS && gpu->slots[slot].under_way)
        slot++;
    assert(slot < GPU_SLOTS);
    return slot;
}

int gpu_run(struct gpu *gpu, const struct gpu_step *steps, size_t count, double *seconds, struct kiln_error *error)
{
    const uint32_t slot = free_slot(gpu);
    const int status = gpu_submit(gpu, slot, steps, count, error);
    return status == KILN_OK ? gpu_wait(gpu, slot, seconds, error) : status;
}

int gpu_run_commands(struct gpu *gpu, gpu_record record, void *context, double *seconds, struct kiln_error *error)
{
    const uint32_t slot = free_slot(gpu);
    int status = gpu_slot_begin(gpu, &gpu->slots[slot], error);
    if (status != KILN_OK)
        return status;
    record(gpu->slots[slot].commands, context);
    status = gpu_slot_end(gpu, &gpu->slots[slot], error);
    return status == KILN_OK ? gpu_wait(gpu, slot, seconds, error) : status;
}

void gpu_clock_read(const struct gpu *gpu, struct gpu_clock *clock)
{
    *clock = (struct gpu_clock){.busy = gpu->busy,
                                .elapsed = gpu->first_submission > 0.0 ? now() - gpu->first_submission : 0.0};
}

/* ---- pace ---- */

uint64_t gpu_pacer_next(const struct gpu_pacer *pacer, uint64_t first_guess)
{
    if (pacer->rate <= 0.0)
        return first_guess > 0 ? first_guess : 1;
    const double work = 0.8 * pacer->slice_seconds * pacer->rate;
    return work >= 0x1p63 ? UINT64_MAX / 2 : work > 1.0 ? (uint64_t)work : 1;
}

uint64_t gpu_pacer_next_filling(const struct gpu_pacer *pacer, uint64_t first_guess, uint64_t least)
{
    const uint64_t enough = gpu_pacer_next(pacer, first_guess), most = enough < UINT64_MAX / 8 ? 4 * enough : enough,
                   filling = pacer->filling < most ? pacer->filling : most,
                   wanted = enough > filling ? enough : filling;
    return wanted > least ? wanted : least;
}

/* Whether half the work or less has taken hardly less time. */
static void compare(struct gpu_pacer *pacer, uint64_t work, double seconds)
{
    const bool smaller = work <= pacer->compared / 2;
    if (smaller && seconds > 0.75 * pacer->compared_seconds)
        pacer->filling = pacer->compared;
    if (smaller || work > pacer->compared) {
        pacer->compared = work;
        pacer->compared_seconds = seconds;
    }
}

void gpu_pacer_learn(struct gpu_pacer *pacer, uint64_t work, double seconds)
{
    if (work == 0 || seconds <= 0.0)
        return;
    const double rate = (double)work / seconds;
    /* slower at once, faster by and by */
    pacer->rate = rate < pacer->rate || pacer->rate <= 0.0 ? rate : 0.5 * (rate + pacer->rate);
    compare(pacer, work, seconds);
}
