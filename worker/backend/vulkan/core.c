/* Functions for all files of the backend: the scene's root struct, Sobol' points, clocks, recovery from failures. */
#include <time.h>

#include "worker/backend/vulkan/vulkan.h"
#include "worker/base/memory.h"
#include "worker/sampling/sequence.h"

enum { MOST_RECOVERIES = 3 };
static const uint64_t LEAST_SCRATCH = 1ull << 20; /* bytes */

/* Uploads the root struct with all addresses. Call it after each change of an address. */
int vulkan_upload_root(struct vulkan_backend *b, struct kiln_error *error)
{
    const int status = gpu_upload(b->gpu, &b->scene, 0, &b->layout, sizeof b->layout, error);
    if (status != KILN_OK || b->params.direct_lights == NULL)
        return status;
    struct kiln_gpu_scene direct = b->layout;
    direct.lights = b->direct_layout;
    return gpu_upload(b->gpu, &b->direct_scene, 0, &direct, sizeof direct, error);
}

struct vulkan_once vulkan_once_begin(void) { return (struct vulkan_once){kiln_clock_seconds(), clock()}; }

void vulkan_once_end(struct vulkan_backend *b, struct vulkan_once begin)
{
    b->once_seconds += kiln_clock_seconds() - begin.seconds;
    b->once_processor += (double)(clock() - begin.processor) / CLOCKS_PER_SEC;
}

int vulkan_sobol(struct vulkan_backend *b, uint32_t count, struct kiln_error *error)
{
    const bool exact = gpu_guarded(b->gpu);
    if (exact ? b->sobol_count == count : b->sobol_count >= count)
        return KILN_OK;
    const uint32_t room = count < 1024 && !exact ? 1024 : count;
    uint32_t *table = NULL;
    gpu_buffer_destroy(b->gpu, &b->sobol);
    b->sobol_count = 0;
    int status;
    KILN_TRY(kiln_allocate(&table, (size_t)room * KILN_DIMENSIONS, sizeof *table, "the samples of a pass", error));
    for (uint32_t d = 0; d < KILN_DIMENSIONS; d++)
        for (uint32_t k = 0; k < room; k++)
            table[(size_t)d * room + k] = kiln_sobol(k, d);
    KILN_TRY(gpu_buffer_of(b->gpu, &b->sobol, table, (size_t)room * KILN_DIMENSIONS * sizeof *table,
                           "the samples of a pass", error));
    b->sobol_count = room;
end:
    kiln_free(&table);
    return status;
}

bool vulkan_can_recover(const struct vulkan_backend *b)
{
    return b->gpu != NULL && b->recoveries < MOST_RECOVERIES && (gpu_lost(b->gpu) || gpu_short_of_memory(b->gpu));
}

int vulkan_recover(struct vulkan_backend *b, struct kiln_error *error)
{
    struct kiln_error why = {"the device failed"};
    if (error != NULL)
        why = *error;
    if (!gpu_lost(b->gpu))
        b->scratch_most /= 2;
    int status = KILN_NO_DEVICE;
    while (status != KILN_OK && b->recoveries < MOST_RECOVERIES && b->scratch_most >= LEAST_SCRATCH) {
        b->recoveries++;
        status = b->make_anew(b, error);
    }
    if (status != KILN_OK)
        return kiln_fail(error, KILN_NO_DEVICE,
                         "%.300s; made anew %u times without success: use --backend embree or another --device",
                         why.message, b->recoveries);
    return KILN_OK;
}

int vulkan_run_to_end(struct vulkan_backend *b, vulkan_run_left run_left, const void *parameters,
                      const struct kiln_batch *batch, uint64_t *rays, struct kiln_error *error)
{
    struct kiln_batch left = *batch;
    bool refused = false;
    int status = run_left(b, parameters, &left, rays, &refused, error);
    while (status != KILN_OK && !refused && vulkan_can_recover(b)) {
        status = vulkan_recover(b, error);
        if (status == KILN_OK)
            status = run_left(b, parameters, &left, rays, &refused, error);
    }
    return status;
}

int vulkan_grow_buffer(struct vulkan_backend *b, struct gpu_buffer *buffer, size_t size, enum gpu_memory memory,
                       const char *what, struct kiln_error *error)
{
    if (gpu_guarded(b->gpu) ? buffer->size == size : buffer->size >= size)
        return KILN_OK;
    gpu_buffer_destroy(b->gpu, buffer);
    return gpu_buffer_create(b->gpu, buffer, size, memory, what, error);
}
