/* The validity pass (worker/pass/validity.h): runs shaders/validity.comp over the batch's points, then again over those
 * that the first run could not decide. Results are handed over after both. */
#include "worker/backend/vulkan/chunks.h"
#include "worker/base/memory.h"
#include "worker/pass/validity.h"

#include "shaders/shared/streams.h"

static const struct vulkan_shader validity_shader = {
    .name = "validity", .compute = VULKAN_CODE(validity), .pipeline = VULKAN_CODE(validity_pipeline)};

struct validity {
    struct vulkan_backend *b;
    struct gpu_kernel *kernel;
    uint64_t first;    /* own index of the batch's first point */
    uint16_t *visible; /* results, of the batch's points */
    uint64_t *open;    /* own indices of points that the first run could not decide */
    size_t open_count, open_room;
    uint64_t rays;
};

static struct kiln_gpu_validity_push push_of(const struct validity *v, struct kiln_gpu_chunk chunk, uint64_t counts,
                                             uint32_t stream, uint32_t looks)
{
    return (struct kiln_gpu_validity_push){.scene = v->b->scene.address,
                                           .chunk = chunk,
                                           .sobol = v->b->sobol.address,
                                           .counts = counts,
                                           .stream = stream,
                                           .sobol_stride = v->b->sobol_count,
                                           .looks = looks};
}

static int record(void *context, const struct vulkan_chunk *chunk, struct vulkan_recording *recording,
                  struct kiln_error *error)
{
    (void)error;
    const struct validity *v = context;
    const struct kiln_gpu_validity_push push =
        push_of(v, chunk->all, chunk->words, KILN_VALIDITY_FIRST_STREAM, KILN_VALIDITY_FIRST_LOOK);
    vulkan_record(recording, v->kernel, chunk->all.count, 1, &push, sizeof push);
    return KILN_OK;
}

static int take(void *context, size_t tile_run_first, size_t tile_run_count, const void *results, const uint32_t *words,
                struct kiln_error *error)
{
    (void)results;
    struct validity *v = context;
    const struct kiln_surface *s = v->b->surface;
    const struct kiln_tile_run *tile_runs = s->tile_runs + tile_run_first;
    const uint64_t first = kiln_own_of_global(s, tile_runs[0].first).at,
                   end = first + kiln_tile_runs_points(tile_runs, tile_runs + tile_run_count - 1);
    v->rays += (end - first) * KILN_VALIDITY_FIRST_LOOK;
    for (uint64_t own = first; own < end; own++) {
        const uint32_t buried = words[own - first];
        v->visible[own - v->first] = buried == 0 ? 0xffff : 0;
        if (buried == 0 || buried == KILN_VALIDITY_FIRST_LOOK)
            continue;
        const int status = kiln_grow(&v->open, &v->open_room, v->open_count + 1, sizeof *v->open,
                                     "points that are partly buried", error);
        if (status != KILN_OK)
            return status;
        v->open[v->open_count++] = own;
    }
    return KILN_OK;
}

/* Runs again for `count` undecided points of one block. `open`: their own indices. */
static int look_again(struct validity *v, const struct vulkan_point_range *block, const uint64_t *open, uint32_t count,
                      struct kiln_error *error)
{
    struct gpu *gpu = v->b->gpu;
    struct gpu_buffer list = {0}, counts = {0};
    uint32_t *numbers = NULL;
    int status = kiln_allocate(&numbers, count, sizeof *numbers, "points that are partly buried", error);
    for (uint32_t i = 0; status == KILN_OK && i < count; i++)
        numbers[i] = (uint32_t)(open[i] - block->first.at);
    if (status == KILN_OK)
        status = gpu_buffer_of(gpu, &list, numbers, count * sizeof *numbers, "points that are partly buried", error);
    if (status == KILN_OK)
        status = gpu_buffer_create(gpu, &counts, count * sizeof *numbers, GPU_HOST, "what is buried of them", error);
    struct gpu_pacer *pacer = &v->b->pacers[KILN_PASS_INDEX_validity];
    for (uint32_t first = 0; first < count && status == KILN_OK;) {
        uint64_t at_once = gpu_pacer_next(pacer, 1 << 16) / KILN_VALIDITY_SECOND_LOOK + 1;
        at_once = at_once < count - first ? at_once : count - first;
        const struct kiln_gpu_chunk chunk = {.points = block->points.address,
                                             .parts = block->parts.address,
                                             .states = block->states.address,
                                             .list = list.address,
                                             .first = first,
                                             .count = (uint32_t)at_once};
        const struct kiln_gpu_validity_push push = push_of(v, chunk, counts.address + first * sizeof *numbers,
                                                           KILN_VALIDITY_SECOND_STREAM, KILN_VALIDITY_SECOND_LOOK);
        const struct gpu_step step = {.kernel = v->kernel,
                                      .threads_x = (uint32_t)at_once,
                                      .threads_y = 1,
                                      .constants = &push,
                                      .constant_bytes = sizeof push};
        double seconds;
        status = gpu_run(gpu, &step, 1, &seconds, error);
        if (status == KILN_OK)
            gpu_pacer_learn(pacer, at_once * KILN_VALIDITY_SECOND_LOOK, seconds);
        first += (uint32_t)at_once;
    }
    for (uint32_t i = 0; status == KILN_OK && i < count; i++)
        v->visible[open[i] - v->first] = kiln_validity_share(((const uint32_t *)counts.mapped)[i]);
    v->rays += (uint64_t)count * KILN_VALIDITY_SECOND_LOOK;
    gpu_buffer_destroy(gpu, &list);
    gpu_buffer_destroy(gpu, &counts);
    kiln_free(&numbers);
    return status;
}

/* Runs again block by block; undecided points are in ascending order. */
static int look_at_open(struct validity *v, size_t tile_run_first, size_t tile_run_count, struct kiln_error *error)
{
    int status = KILN_OK;
    size_t next = 0;
    for (size_t f = tile_run_first; f < tile_run_first + tile_run_count && status == KILN_OK && next < v->open_count;) {
        struct vulkan_point_range *block;
        status = vulkan_points_range(v->b->points, f, false, 0, &block, error);
        size_t end = next;
        while (status == KILN_OK && end < v->open_count && v->open[end] < block->first.at + block->count)
            end++;
        if (end > next)
            status = look_again(v, block, v->open + next, (uint32_t)(end - next), error);
        next = end;
        f = status == KILN_OK ? block->tile_run_first + block->tile_run_count : f;
    }
    return status;
}

static int prepare(void *context, struct kiln_error *error)
{
    struct validity *v = context;
    const int status = vulkan_sobol(v->b, KILN_VALIDITY_SECOND_LOOK, error);
    return status == KILN_OK ? vulkan_kernel_of(v->b, &validity_shader, false, 0, &v->kernel, error) : status;
}

/* Both looks, from the beginning. */
static int look(struct validity *v, const struct kiln_batch *batch, struct kiln_error *error)
{
    const struct vulkan_chunked pass = {.pass = &kiln_pass_validity,
                                        .pace = KILN_PASS_INDEX_validity,
                                        .rows = 1,
                                        .work = KILN_VALIDITY_FIRST_LOOK,
                                        .first_guess = 1 << 18,
                                        .wants_words = true,
                                        .prepare = prepare,
                                        .record = record,
                                        .take = take,
                                        .context = v};
    v->open_count = 0;
    v->rays = 0;
    const int status = vulkan_run_in_chunks(v->b, &pass, batch, error);
    return status == KILN_OK ? look_at_open(v, batch->first, batch->count, error) : status;
}

static int run(struct vulkan_backend *b, const void *parameters, const struct kiln_batch *batch, uint64_t *rays,
               struct kiln_error *error)
{
    (void)parameters;
    const struct kiln_tile_run *run = &b->surface->tile_runs[batch->first], *last = run + batch->count - 1;
    struct validity v = {.b = b, .first = kiln_own_of_global(b->surface, run->first).at};
    int status = kiln_allocate(&v.visible, (size_t)kiln_tile_runs_points(run, last), sizeof *v.visible,
                               "the validity pass", error);
    if (status == KILN_OK)
        status = look(&v, batch, error);
    while (status != KILN_OK && vulkan_can_recover(b)) {
        status = vulkan_recover(b, error);
        if (status == KILN_OK)
            status = look(&v, batch, error);
    }
    *rays += status == KILN_OK ? v.rays : 0;
    if (status == KILN_OK && batch->take != NULL)
        status = batch->take(batch->context, batch->first, batch->count, v.visible, error);
    if (b->points != NULL)                      /* NULL if the device could not be created again */
        vulkan_points_forget_states(b->points); /* the taker writes the results to surface->visible */
    kiln_free(&v.open);
    kiln_free(&v.visible);
    return status;
}

const struct vulkan_pass vulkan_pass_validity = {.run = run, .ahead = {{.shader = &validity_shader}}};
