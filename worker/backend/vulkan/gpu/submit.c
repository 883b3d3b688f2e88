#include <assert.h>
#include <time.h>

#include "worker/backend/vulkan/gpu/private.h"

/* limit for one submission; a device that takes longer counts as lost */
#define PATIENCE_NANOSECONDS 600000000000ull

static double now(void)
{
    struct timespec t;
    (void)clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* ---- slots ---- */

static VkResult create_commands(struct gpu *gpu, struct gpu_commands *commands, uint32_t family)
{
    const VkCommandPoolCreateInfo pool = {.sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO,
                                          .flags = VK_COMMAND_POOL_CREATE_TRANSIENT_BIT,
                                          .queueFamilyIndex = family};
    const VkResult result = GPU_TRY(gpu, vkCreateCommandPool(gpu->device, &pool, NULL, &commands->pool));
    const VkCommandBufferAllocateInfo buffer = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO,
                                                .commandPool = commands->pool,
                                                .level = VK_COMMAND_BUFFER_LEVEL_PRIMARY,
                                                .commandBufferCount = 1};
    return result == VK_SUCCESS ? GPU_TRY(gpu, vkAllocateCommandBuffers(gpu->device, &buffer, &commands->buffer))
                                : result;
}

static VkResult create_slot(struct gpu *gpu, struct gpu_slot *slot)
{
    const VkSemaphoreTypeCreateInfo timeline = {.sType = VK_STRUCTURE_TYPE_SEMAPHORE_TYPE_CREATE_INFO,
                                                .semaphoreType = VK_SEMAPHORE_TYPE_TIMELINE};
    const VkSemaphoreCreateInfo semaphore = {.sType = VK_STRUCTURE_TYPE_SEMAPHORE_CREATE_INFO, .pNext = &timeline};
    const VkFenceCreateInfo fence = {.sType = VK_STRUCTURE_TYPE_FENCE_CREATE_INFO};
    const VkQueryPoolCreateInfo queries = {.sType = VK_STRUCTURE_TYPE_QUERY_POOL_CREATE_INFO,
                                           .queryType = VK_QUERY_TYPE_TIMESTAMP,
                                           .queryCount = 2 + GPU_TIMED_STEPS};
    VkResult result = create_commands(gpu, &slot->kernels, gpu->queue_family);
    if (result == VK_SUCCESS)
        result = create_commands(gpu, &slot->copies, gpu->copy_family);
    if (result == VK_SUCCESS)
        result = GPU_TRY(gpu, vkCreateSemaphore(gpu->device, &semaphore, NULL, &slot->kernels_done));
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
        vkDestroySemaphore(gpu->device, gpu->slots[i].kernels_done, NULL);
        vkDestroyCommandPool(gpu->device, gpu->slots[i].copies.pool, NULL); /* with its commands */
        vkDestroyCommandPool(gpu->device, gpu->slots[i].kernels.pool, NULL);
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

static int begin_commands(struct gpu *gpu, const struct gpu_commands *commands, struct kiln_error *error)
{
    const VkCommandBufferBeginInfo info = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO,
                                           .flags = VK_COMMAND_BUFFER_USAGE_ONE_TIME_SUBMIT_BIT};
    VkResult result = GPU_TRY(gpu, vkResetCommandPool(gpu->device, commands->pool, 0));
    if (result == VK_SUCCESS)
        result = GPU_TRY(gpu, vkBeginCommandBuffer(commands->buffer, &info));
    if (result != VK_SUCCESS)
        return gpu_failure(gpu, result, error, "cannot record commands");
    gpu_barrier(commands->buffer);
    return KILN_OK;
}

/* Begins a slot. Timestamps are taken after all earlier commands are complete, so that the sum over slots never exceeds
 * the time that has passed. */
int gpu_slot_begin(struct gpu *gpu, struct gpu_slot *slot, struct kiln_error *error)
{
    assert(!slot->under_way);
    const int status = begin_commands(gpu, &slot->kernels, error);
    if (status != KILN_OK)
        return status;
    slot->timed = gpu->limits.timestampPeriod > 0.0f;
    vkCmdResetQueryPool(slot->kernels.buffer, slot->queries, 0, 2 + GPU_TIMED_STEPS);
    slot->steps = 0;
    if (slot->timed)
        vkCmdWriteTimestamp(slot->kernels.buffer, VK_PIPELINE_STAGE_BOTTOM_OF_PIPE_BIT, slot->queries, 0);
    return KILN_OK;
}

int gpu_slot_begin_copies(struct gpu *gpu, struct gpu_slot *slot, struct kiln_error *error)
{
    assert(!slot->under_way);
    slot->timed = false;
    return begin_commands(gpu, &slot->copies, error);
}

/* Ends and submits the commands; with `fence` the slot is then under way. */
static int submit_commands(struct gpu *gpu, VkQueue queue, VkSubmitInfo info, VkFence fence, struct kiln_error *error)
{
    info.sType = VK_STRUCTURE_TYPE_SUBMIT_INFO;
    info.commandBufferCount = 1;
    VkResult result = GPU_TRY(gpu, vkEndCommandBuffer(*info.pCommandBuffers));
    if (result == VK_SUCCESS && fence != VK_NULL_HANDLE)
        result = GPU_TRY(gpu, vkResetFences(gpu->device, 1, &fence));
    if (result == VK_SUCCESS)
        result = GPU_TRY(gpu, vkQueueSubmit(queue, 1, &info, fence));
    return result == VK_SUCCESS ? KILN_OK : gpu_failure(gpu, result, error, "the device takes no commands");
}

static void end_kernels(const struct gpu *gpu, const struct gpu_slot *slot)
{
    gpu_guard_mark(gpu, slot->kernels.buffer, NULL);
    gpu_barrier(slot->kernels.buffer);
    if (slot->timed)
        vkCmdWriteTimestamp(slot->kernels.buffer, VK_PIPELINE_STAGE_BOTTOM_OF_PIPE_BIT, slot->queries, 1);
}

int gpu_slot_end(struct gpu *gpu, struct gpu_slot *slot, struct kiln_error *error)
{
    end_kernels(gpu, slot);
    const VkSubmitInfo info = {.pCommandBuffers = &slot->kernels.buffer};
    const int status = submit_commands(gpu, gpu->queue, info, slot->fence, error);
    slot->under_way = status == KILN_OK;
    return status;
}

int gpu_slot_end_copies(struct gpu *gpu, struct gpu_slot *slot, struct kiln_error *error)
{
    gpu_barrier(slot->copies.buffer);
    const VkSubmitInfo info = {.pCommandBuffers = &slot->copies.buffer};
    const int status = submit_commands(gpu, gpu->copy_queue, info, slot->fence, error);
    slot->under_way = status == KILN_OK;
    return status;
}

/* Submits the kernels, and on the other queue the copy that waits for them. */
static int end_with_copy(struct gpu *gpu, struct gpu_slot *slot, const struct gpu_step *copy, struct kiln_error *error)
{
    const VkPipelineStageFlags stage = VK_PIPELINE_STAGE_ALL_COMMANDS_BIT;
    const uint64_t value = ++slot->submissions;
    const VkTimelineSemaphoreSubmitInfo values = {.sType = VK_STRUCTURE_TYPE_TIMELINE_SEMAPHORE_SUBMIT_INFO,
                                                  .waitSemaphoreValueCount = 1,
                                                  .pWaitSemaphoreValues = &value,
                                                  .signalSemaphoreValueCount = 1,
                                                  .pSignalSemaphoreValues = &value};
    const VkSubmitInfo first = {.pNext = &values,
                                .pCommandBuffers = &slot->kernels.buffer,
                                .signalSemaphoreCount = 1,
                                .pSignalSemaphores = &slot->kernels_done};
    const VkSubmitInfo second = {.pNext = &values,
                                 .pCommandBuffers = &slot->copies.buffer,
                                 .waitSemaphoreCount = 1,
                                 .pWaitSemaphores = &slot->kernels_done,
                                 .pWaitDstStageMask = &stage};
    end_kernels(gpu, slot);
    int status = begin_commands(gpu, &slot->copies, error);
    if (status != KILN_OK)
        return status;
    gpu_copy_record(gpu, slot->copies.buffer, copy);
    gpu_barrier(slot->copies.buffer);
    status = submit_commands(gpu, gpu->queue, first, VK_NULL_HANDLE, error);
    if (status != KILN_OK)
        return status;
    status = submit_commands(gpu, gpu->copy_queue, second, slot->fence, error);
    slot->under_way = status == KILN_OK;
    if (status != KILN_OK) /* the kernels are running, but the slot must be free */
        (void)vkDeviceWaitIdle(gpu->device);
    return status;
}

static VkResult read_clock(struct gpu *gpu, const struct gpu_slot *slot, double *seconds)
{
    uint64_t ticks[2] = {0, 0};
    *seconds = 0.0;
    if (!slot->timed)
        return VK_SUCCESS;
    const VkResult result =
        GPU_TRY(gpu, vkGetQueryPoolResults(gpu->device, slot->queries, 0, 2, sizeof ticks, ticks, sizeof *ticks,
                                           VK_QUERY_RESULT_64_BIT | VK_QUERY_RESULT_WAIT_BIT));
    *seconds = ticks[1] > ticks[0] ? (double)(ticks[1] - ticks[0]) * (double)gpu->limits.timestampPeriod * 1e-9 : 0.0;
    return result;
}

/* Marks the end of a step, if steps are timed individually. */
static void mark_step(const struct gpu *gpu, struct gpu_slot *slot, const struct gpu_step *step)
{
    if (gpu->times == NULL || !slot->timed || slot->steps == GPU_TIMED_STEPS)
        return;
    slot->step_kernels[slot->steps] = step->kernel;
    slot->step_threads[slot->steps] = step->kernel != NULL ? (uint64_t)step->threads_x * step->threads_y : step->size;
    gpu_barrier(slot->kernels.buffer);
    vkCmdWriteTimestamp(slot->kernels.buffer, VK_PIPELINE_STAGE_BOTTOM_OF_PIPE_BIT, slot->queries, 2 + slot->steps++);
}

static VkResult read_steps(struct gpu *gpu, const struct gpu_slot *slot)
{
    uint64_t ticks[1 + GPU_TIMED_STEPS], begin;
    if (gpu->times == NULL || !slot->timed || slot->steps == 0)
        return VK_SUCCESS;
    VkResult result = GPU_TRY(gpu, vkGetQueryPoolResults(gpu->device, slot->queries, 2, slot->steps, sizeof ticks,
                                                         ticks, sizeof *ticks, VK_QUERY_RESULT_64_BIT));
    if (result == VK_SUCCESS)
        result = GPU_TRY(gpu, vkGetQueryPoolResults(gpu->device, slot->queries, 0, 1, sizeof begin, &begin,
                                                    sizeof begin, VK_QUERY_RESULT_64_BIT));
    for (uint32_t i = 0; i < slot->steps && result == VK_SUCCESS; i++) {
        const double seconds = (double)(ticks[i] - begin) * (double)gpu->limits.timestampPeriod * 1e-9;
        const struct gpu_kernel *kernel = slot->step_kernels[i];
        gpu_times_add(gpu, kernel != NULL ? gpu_kernel_name(kernel) : "copies",
                      kernel != NULL ? gpu_kernel_constant(kernel) : 0, slot->step_threads[i], seconds);
        begin = ticks[i];
    }
    return result;
}

int gpu_slot_wait(struct gpu *gpu, struct gpu_slot *slot, double *seconds, struct kiln_error *error)
{
    double took = 0.0;
    if (seconds != NULL)
        *seconds = 0.0;
    if (!slot->under_way)
        return KILN_OK;
    const double begin = now();
    VkResult result = GPU_TRY(gpu, vkWaitForFences(gpu->device, 1, &slot->fence, VK_TRUE, PATIENCE_NANOSECONDS));
    if (result == VK_TIMEOUT)
        gpu->lost = gpu->hangs = true;
    if (result != VK_SUCCESS && result != VK_TIMEOUT)
        /* the slot or its buffers will be reused, so nothing may still be running */
        (void)vkDeviceWaitIdle(gpu->device);
    if (result == VK_SUCCESS)
        result = read_clock(gpu, slot, &took);
    if (gpu->times != NULL)
        gpu_times_wait(gpu, now() - begin);
    if (result == VK_SUCCESS)
        result = read_steps(gpu, slot);
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

void gpu_copy_record(const struct gpu *gpu, VkCommandBuffer commands, const struct gpu_step *copy)
{
    const VkBufferCopy region = {.srcOffset = gpu_buffer_skip(copy->from) + copy->from_offset,
                                 .dstOffset = gpu_buffer_skip(copy->to) + copy->to_offset,
                                 .size = copy->size};
    assert(copy->from_offset + copy->size <= copy->from->size && copy->to_offset + copy->size <= copy->to->size);
    gpu_guard_mark(gpu, commands, NULL);
    vkCmdCopyBuffer(commands, gpu_vk_buffer(copy->from), gpu_vk_buffer(copy->to), 1, &region);
}

static void record_step(const struct gpu *gpu, VkCommandBuffer commands, const struct gpu_step *step)
{
    if (step->kernel != NULL)
        gpu_kernel_record(step->kernel, commands, step, gpu);
    else
        gpu_copy_record(gpu, commands, step);
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
    const struct gpu_step *aside =
        count > 0 && steps[count - 1].aside && !is_empty(&steps[count - 1]) ? &steps[count - 1] : NULL;
    bool first = true;
    for (size_t i = 0; i < count - (aside != NULL); i++) {
        if (is_empty(&steps[i]))
            continue;
        if (!first && !steps[i].alongside)
            gpu_barrier(s->kernels.buffer);
        first = false;
        record_step(gpu, s->kernels.buffer, &steps[i]);
        mark_step(gpu, s, &steps[i]);
    }
    if (gpu->first_submission <= 0.0)
        gpu->first_submission = now();
    return aside != NULL ? end_with_copy(gpu, s, aside, error) : gpu_slot_end(gpu, s, error);
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
    int status;
    KILN_TRY(gpu_slot_begin(gpu, &gpu->slots[slot], error));
    record(gpu->slots[slot].kernels.buffer, context);
    KILN_TRY(gpu_slot_end(gpu, &gpu->slots[slot], error));
    KILN_TRY(gpu_wait(gpu, slot, seconds, error));
end:
    return status;
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

/* Finds whether half the work or less took hardly less time. */
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
