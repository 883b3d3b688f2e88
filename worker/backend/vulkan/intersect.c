/* Nearest hits of arbitrary rays, whose data are on the device or on the host. */
#include "worker/backend/vulkan/vulkan.h"

static const struct vulkan_shader intersect_shader = {
    .name = "intersect", .compute = VULKAN_CODE(intersect), .pipeline = VULKAN_CODE(intersect_pipeline)};

int vulkan_intersect_on_device(struct vulkan_backend *b, uint64_t origins, uint64_t directions, uint64_t hits,
                               uint32_t count, double *seconds, struct kiln_error *error)
{
    struct gpu_kernel *kernel;
    const int status = vulkan_kernel_of(b, &intersect_shader, false, 0, &kernel, error);
    if (status != KILN_OK)
        return status;
    const struct kiln_gpu_intersect_push push = {
        .scene = b->scene.address, .origins = origins, .directions = directions, .hits = hits, .count = count};
    const struct gpu_step step = {
        .kernel = kernel, .threads_x = count, .threads_y = 1, .constants = &push, .constant_bytes = sizeof push};
    return gpu_run(b->gpu, &step, 1, seconds, error);
}

/* Traces some rays at once, through buffers for `room` rays. */
static int intersect_some(struct vulkan_backend *b, size_t room, const struct kiln_vec3 *origins,
                          const struct kiln_vec3 *directions, size_t count, struct kiln_hit *hits,
                          struct kiln_error *error)
{
    struct kiln_vec3 *from = b->rays.mapped, *to = from + room;
#pragma omp parallel for schedule(static) num_threads((int)b->threads) if (count > 1 << 14)
    for (size_t i = 0; i < count; i++) {
        from[i] = origins[i];
        to[i] = directions[i];
    }
    double seconds;
    const int status = vulkan_intersect_on_device(b, b->rays.address, b->rays.address + room * sizeof *directions,
                                                  b->hits.address, (uint32_t)count, &seconds, error);
    if (status != KILN_OK)
        return status;
    gpu_pacer_learn(&b->pacers[VULKAN_PACE_INTERSECT], count, seconds);
    const struct kiln_gpu_hit *found = b->hits.mapped;
#pragma omp parallel for schedule(static) num_threads((int)b->threads) if (count > 1 << 14)
    for (size_t i = 0; i < count; i++)
        hits[i] = (struct kiln_hit){.triangle = found[i].triangle,
                                    .u = found[i].u,
                                    .v = found[i].v,
                                    .distance = found[i].distance,
                                    .back = found[i].back != 0,
                                    .tint = {found[i].tint[0], found[i].tint[1], found[i].tint[2]}};
    return KILN_OK;
}

static int intersect_all(struct kiln_backend *backend, const struct kiln_vec3 *origins,
                         const struct kiln_vec3 *directions, size_t count, struct kiln_hit *hits,
                         struct kiln_error *error)
{
    enum { MOST = 1 << 20 };
    struct vulkan_backend *b = (struct vulkan_backend *)backend;
    const size_t room = count < MOST ? count : MOST;
    int status = vulkan_grow_buffer(b, &b->rays, 2 * room * sizeof *origins, GPU_HOST, "rays", error);
    if (status == KILN_OK)
        status = vulkan_grow_buffer(b, &b->hits, room * sizeof(struct kiln_gpu_hit), GPU_HOST, "hits", error);
    for (size_t done = 0; done < count && status == KILN_OK;) {
        size_t some = gpu_pacer_next(&b->pacers[VULKAN_PACE_INTERSECT], 1 << 16);
        some = some > room ? room : some < 64 ? 64 : some;
        some = some > count - done ? count - done : some;
        status = intersect_some(b, room, origins + done, directions + done, some, hits + done, error);
        done += some;
    }
    return status;
}

/* Starts over after a recovery. */
int vulkan_intersect(struct kiln_backend *backend, const struct kiln_vec3 *origins, const struct kiln_vec3 *directions,
                     size_t count, const struct kiln_ray_hints *hints, struct kiln_hit *hits, struct kiln_error *error)
{
    (void)hints;
    struct vulkan_backend *b = (struct vulkan_backend *)backend;
    int status = intersect_all(backend, origins, directions, count, hits, error);
    while (status != KILN_OK && vulkan_can_recover(b)) {
        status = vulkan_recover(b, error);
        if (status != KILN_OK)
            return status;
        status = intersect_all(backend, origins, directions, count, hits, error);
    }
    return status;
}
