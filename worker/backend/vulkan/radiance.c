/* The radiance pass (worker/pass/radiance.h): shaders/radiance.comp over the batch's items, as many at once as one
 * slice of time allows. */
#include <stdint.h> /* before the shaders */
#include <string.h>

#include "shaders/shared/streams.h"
#include "worker/backend/vulkan/vulkan.h"
#include "worker/pass/radiance.h"

static const struct vulkan_shader gloss_shader = {.name = "radiance with gloss",
                                                  .compute = VULKAN_CODE(radiance_gloss),
                                                  .pipeline = VULKAN_CODE(radiance_gloss_pipeline)};
static const struct vulkan_shader radiance_shader = {.name = "radiance",
                                                     .compute = VULKAN_CODE(radiance),
                                                     .pipeline = VULKAN_CODE(radiance_pipeline),
                                                     .gloss = &gloss_shader};

_Static_assert(sizeof(struct kiln_radiance_result) == 4 * sizeof(float), "an answer on the device is four floats");

enum { FIRST_GUESS = 1 << 16, MOST_ITEMS = 1 << 18, LEAST_ITEMS = 64 };

/* A call's working set. */
struct radiance_run {
    struct vulkan_backend *b;
    struct gpu_kernel *kernel;
    struct gpu_buffer positions, results;
    struct kiln_gpu_radiance_push push;
};

static int prepare(struct radiance_run *r, const struct kiln_radiance_parameters *map, const struct kiln_batch *batch,
                   struct kiln_error *error)
{
    struct vulkan_backend *b = r->b;
    const uint64_t seed = b->params.seed;
    const size_t room = batch->count < MOST_ITEMS ? batch->count : MOST_ITEMS;
    int status;
    KILN_TRY(vulkan_kernel_of(b, &radiance_shader, false, 0, &r->kernel, error));
    KILN_TRY(vulkan_sobol(b, batch->samples, error));
    KILN_TRY(gpu_buffer_create(b->gpu, &r->positions, room * sizeof(struct kiln_vec3), GPU_HOST,
                               "the positions of radiance probes", error));
    KILN_TRY(gpu_buffer_create(b->gpu, &r->results, room * sizeof(struct kiln_radiance_result), GPU_HOST,
                               "the answers of radiance probes", error));
end:
    r->push =
        (struct kiln_gpu_radiance_push){.scene = b->scene.address,
                                        .positions = r->positions.address,
                                        .results = r->results.address,
                                        .sobol = b->sobol.address,
                                        .samples = batch->samples,
                                        .sobol_stride = b->sobol_count,
                                        .seed = kiln_hash2((uint32_t)seed, (uint32_t)(seed >> 32) ^ KILN_RADIANCE_SEED),
                                        .stream = batch->stream,
                                        .basis = map->basis,
                                        .side = map->side,
                                        .period = map->period};
    return status;
}

/* Number of next items that fit into a time slice. */
static uint32_t size_chunk(const struct radiance_run *r, size_t left)
{
    const uint64_t rays = gpu_pacer_next(&r->b->pacers[KILN_PASS_INDEX_radiance], FIRST_GUESS);
    uint64_t some = rays / r->push.samples;
    some = some < LEAST_ITEMS ? LEAST_ITEMS : some > MOST_ITEMS ? MOST_ITEMS : some;
    return (uint32_t)(some < left ? some : left);
}

static int run_chunk(struct radiance_run *r, const struct kiln_batch *left, uint32_t count, struct kiln_error *error)
{
    double seconds;
    memcpy(r->positions.mapped, left->positions, count * sizeof *left->positions);
    r->push.index = left->first;
    r->push.count = count;
    const struct gpu_step step = {.kernel = r->kernel,
                                  .threads_x = count,
                                  .threads_y = 1,
                                  .constants = &r->push,
                                  .constant_bytes = sizeof r->push};
    const int status = gpu_run(r->b->gpu, &step, 1, &seconds, error);
    if (status != KILN_OK)
        return status;
    gpu_pacer_learn(&r->b->pacers[KILN_PASS_INDEX_radiance], (uint64_t)count * r->push.samples, seconds);
    const struct kiln_radiance_result *results = r->results.mapped;
    for (uint32_t i = 0; i < count; i++)
        if (results[i].back < 0.0f) /* see `check` in chunks.c */
            return kiln_fail(error, KILN_NO_DEVICE,
                             "%s ends long loops early, and a radiance probe needs one; use another device, "
                             "--backend embree, or fewer --samples-radiance-probe",
                             gpu_about(r->b->gpu)->name);
    return KILN_OK;
}

/* Runs the rest of the batch until it is done or fails; `left` becomes the part not taken. `refused`: the taker failed,
 * not the device. */
static int run_left(struct vulkan_backend *b, const void *parameters, struct kiln_batch *left, uint64_t *rays,
                    bool *refused, struct kiln_error *error)
{
    const struct kiln_radiance_parameters *map = parameters;
    struct radiance_run r = {.b = b};
    int status = prepare(&r, map, left, error);
    while (left->count > 0 && status == KILN_OK) {
        const uint32_t count = size_chunk(&r, left->count);
        status = run_chunk(&r, left, count, error);
        if (status == KILN_OK) {
            *rays += (uint64_t)count * left->samples;
            status =
                left->take != NULL ? left->take(left->context, left->first, count, r.results.mapped, error) : KILN_OK;
            *refused = status != KILN_OK;
            *left = kiln_batch_range(left, left->first + count, left->count - count);
        }
    }
    gpu_buffer_destroy(b->gpu, &r.positions);
    gpu_buffer_destroy(b->gpu, &r.results);
    return status;
}

static int run(struct vulkan_backend *b, const void *parameters, const struct kiln_batch *batch, uint64_t *rays,
               struct kiln_error *error)
{
    return vulkan_run_to_end(b, run_left, parameters, batch, rays, error);
}

const struct vulkan_pass vulkan_pass_radiance = {.run = run};
