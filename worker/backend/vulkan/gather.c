/* The gather pass (worker/pass/gather.h): shaders/gather.comp and gather_reduce.comp over the batch's points. */
#include "worker/backend/vulkan/chunks.h"
#include "worker/pass/gather.h"
#include "worker/sampling/keys.h"

#include "shaders/gather.h"
#include "shaders/gather_pipeline.h"
#include "shaders/gather_reduce.h"

const struct vulkan_shader vulkan_gather_shader = {
    .name = "gather", .compute = VULKAN_CODE(gather), .pipeline = VULKAN_CODE(gather_pipeline)};
const struct vulkan_shader vulkan_gather_sums_shader = {.name = "gather: sums", .compute = VULKAN_CODE(gather_reduce)};

struct gather {
    struct vulkan_backend *b;
    const struct kiln_batch *batch;
    struct gpu_kernel *whole, *reduce;
    struct gpu_kernel *buried; /* made when there is a point for it: it takes its time */
    uint32_t samples, stream;
    struct vulkan_slices slices;
    uint32_t lookup; /* 0: rays are traced and that is all */
    uint64_t rays;
};

static int record(void *context, const struct vulkan_chunk *chunk, struct vulkan_recording *recording,
                  struct kiln_error *error)
{
    struct gather *g = context;
    const int status = chunk->buried.count > 0
                           ? vulkan_kernel_of(g->b, &vulkan_gather_shader, true, g->lookup, &g->buried, error)
                           : KILN_OK;
    if (status != KILN_OK)
        return status;
    const struct kiln_gpu_gather_push push = {.scene = g->b->scene.address,
                                              .chunk = chunk->all,
                                              .sobol = g->b->sobol.address,
                                              .slices = chunk->scratch,
                                              .samples = g->samples,
                                              .stream = g->stream,
                                              .reuse = kiln_position_reuse(g->samples),
                                              .sobol_stride = g->b->sobol_count,
                                              .per_quarter = g->slices.per_quarter,
                                              .row_first = chunk->row_first,
                                              .slice = g->slices.samples,
                                              .row_step = g->slices.split};
    struct kiln_gpu_gather_push buried = push;
    buried.chunk = chunk->buried;
    buried.per_quarter *= g->slices.split;
    buried.row_first *= g->slices.split;
    buried.slice /= g->slices.split;
    buried.row_step = 1;
    const struct vulkan_dispatch both[2] = {
        {g->buried, chunk->buried.count, chunk->row_count * g->slices.split, &buried},
        {g->whole, chunk->all.count, chunk->row_count, &push}};
    vulkan_record_both(recording, both, sizeof push);
    const struct kiln_gpu_gather_reduce_push reduce = {.scene = g->b->scene.address,
                                                       .chunk = chunk->all,
                                                       .slices = chunk->scratch,
                                                       .results = chunk->results,
                                                       .samples = g->samples,
                                                       .per_quarter = g->slices.per_quarter,
                                                       .split = g->slices.split};
    if (chunk->last)
        vulkan_record(recording, g->reduce, chunk->all.total, 1, &reduce, sizeof reduce);
    return KILN_OK;
}

static int take(void *context, size_t tile_run_first, size_t tile_run_count, const void *results, const uint32_t *words,
                struct kiln_error *error)
{
    (void)words;
    struct gather *g = context;
    const struct kiln_surface *s = g->b->surface;
    const struct kiln_tile_run *tile_runs = s->tile_runs + tile_run_first;
    const uint64_t first = kiln_own_of_global(s, tile_runs[0].first).at,
                   end = first + kiln_tile_runs_points(tile_runs, tile_runs + tile_run_count - 1);
    uint64_t valid = 0;
#pragma omp parallel for num_threads((int)g->b->threads) reduction(+ : valid) if (end - first > 1 << 14)
    for (uint64_t own = first; own < end; own++)
        valid += kiln_point_valid(s, (struct kiln_own_point){own});
    g->rays += valid * g->samples;
    return g->batch->take != NULL ? g->batch->take(g->batch->context, tile_run_first, tile_run_count, results, error)
                                  : KILN_OK;
}

static int prepare(void *context, struct kiln_error *error)
{
    struct gather *g = context;
    int status = vulkan_sobol(g->b, g->samples, error);
    if (status == KILN_OK)
        status = vulkan_kernel_of(g->b, &vulkan_gather_shader, false, g->lookup, &g->whole, error);
    if (status == KILN_OK)
        status = vulkan_kernel_of(g->b, &vulkan_gather_sums_shader, false, 0, &g->reduce, error);
    return status;
}

static int run(struct gather *g, uint32_t pace, double *seconds, struct kiln_error *error)
{
    g->samples = g->batch->samples;
    g->stream = g->batch->stream;
    g->slices = vulkan_slices_of(g->b, g->samples);
    const uint32_t rows = 4 * g->slices.per_quarter;
    const uint32_t floats =
        g->b->params.geometry->passage == KILN_PASSAGE_TINT ? KILN_GPU_SLICE_TINTED_FLOATS : KILN_GPU_SLICE_FLOATS;
    const struct vulkan_chunked pass = {.pass = &kiln_pass_gather,
                                        .pace = pace,
                                        .states = true,
                                        .result_bytes = sizeof(struct kiln_gpu_result),
                                        .failed_offset = offsetof(struct kiln_gpu_result, error),
                                        .rows = rows,
                                        .work = (double)g->samples / rows,
                                        .first_guess = 1 << 19,
                                        .scratch_bytes = (size_t)rows * g->slices.split * floats * sizeof(float),
                                        .prepare = prepare,
                                        .record = record,
                                        .take = take,
                                        .context = g,
                                        .seconds = seconds};
    return vulkan_run_in_chunks(g->b, &pass, g->batch, error);
}

int vulkan_gather(struct vulkan_backend *b, const void *parameters, const struct kiln_batch *batch, uint64_t *rays,
                  struct kiln_error *error)
{
    (void)parameters;
    struct gather g = {.b = b, .batch = batch, .lookup = 1};
    const int status = run(&g, KILN_PASS_INDEX_gather, NULL, error);
    *rays += g.rays;
    return status;
}

int vulkan_ceiling(struct kiln_backend *backend, const struct kiln_batch *batch, double *seconds, uint64_t *rays,
                   struct kiln_error *error)
{
    struct kiln_batch nobody = *batch;
    nobody.take = NULL;
    struct gather g = {.b = (struct vulkan_backend *)backend, .batch = &nobody};
    const int status = run(&g, VULKAN_PACE_CEILING, seconds, error);
    *rays += g.rays;
    return status;
}
