/* The path pass (worker/pass/path.h): shaders/path.glsl follows some paths of each pixel in a chunk, and adds them to
 * the pixel's sums. Their number is chosen to fit a time slice; results do not depend on it. */
#include <stdint.h> /* before the shaders */
#include <string.h>

#include "worker/backend/vulkan/vulkan.h"
#include "worker/base/memory.h"

static const struct vulkan_shader gloss_shader = {.name = "path with gloss",
                                                  .compute = VULKAN_CODE(path_gloss),
                                                  .pipeline = VULKAN_CODE(path_gloss_pipeline),
                                                  .compute_float = VULKAN_CODE(path_gloss_float),
                                                  .pipeline_float = VULKAN_CODE(path_gloss_pipeline_float)};
static const struct vulkan_shader path_shader = {.name = "path",
                                                 .compute = VULKAN_CODE(path),
                                                 .pipeline = VULKAN_CODE(path_pipeline),
                                                 .compute_float = VULKAN_CODE(path_float),
                                                 .pipeline_float = VULKAN_CODE(path_pipeline_float),
                                                 .gloss = &gloss_shader};

/* At diffuse surfaces, in scenes with gloss. */
static const struct vulkan_shader diffuse_shader = {.name = "path at diffuse surfaces",
                                                    .compute = VULKAN_CODE(path_diffuse),
                                                    .pipeline = VULKAN_CODE(path_diffuse_pipeline),
                                                    .compute_float = VULKAN_CODE(path_diffuse_float),
                                                    .pipeline_float = VULKAN_CODE(path_diffuse_pipeline_float)};
static const struct vulkan_shader add_shader = {.name = "path: sums", .compute = VULKAN_CODE(path_add)};

/* Limits of a dispatch; a software device ends a thread's loops after 65,535 iterations in all. TURNS: in scenes with
 * gloss, the largest number of changes between kernels, before the last kernel follows a path to its end. MOST_PATHS:
 * active paths. */
enum { MOST_PIXELS = 1 << 18, MOST_SAMPLES = 16, MOST_SAMPLES_SOFTWARE = 2, FIRST_GUESS = 1 << 14 };
enum { TURNS = 6, MOST_PATHS = 1 << 20 };

/* A call's working set. */
struct path_run {
    struct vulkan_backend *b;
    struct gpu_kernel *kernel;
    struct gpu_kernel *diffuse, *clear, *add; /* NULL: there is no gloss, and `kernel` does all work */
    struct gpu_buffer sums;
    /* of paths that move between kernels: TURNS times struct kiln_gpu_path_turn, TURNS words that count paths, two
     * lists of paths, and a struct kiln_gpu_path_state for each */
    struct gpu_buffer apart;
    uint32_t most_samples;            /* of a dispatch */
    struct kiln_path_result *answers; /* of a chunk, for the taker */
    uint32_t room;                    /* pixels that fit into the buffer and `answers` */
    struct kiln_gpu_path_push push;
};

static uint64_t counters_of(const struct path_run *r)
{
    return r->apart.address + TURNS * sizeof(struct kiln_gpu_path_turn);
}

/* Describes the turns. Kernels alternate, beginning with the one for diffuse surfaces. Each passes paths to the next
 * one; the last one passes none. */
static void describe_turns(const struct path_run *r, uint64_t paths, struct kiln_gpu_path_turn turns[TURNS])
{
    const uint64_t counters = counters_of(r), lists = counters + TURNS * sizeof(uint32_t),
                   states = lists + 2 * paths * sizeof(uint32_t);
    for (uint32_t i = 0; i < TURNS; i++) {
        const uint64_t own = lists + i % 2 * paths * sizeof(uint32_t),
                       other = lists + (i + 1) % 2 * paths * sizeof(uint32_t);
        turns[i] = (struct kiln_gpu_path_turn){.states = states};
        if (i > 0) {
            turns[i].list = own;
            turns[i].counter = counters + i * sizeof(uint32_t);
        }
        if (i + 1 < TURNS) {
            turns[i].onward = other;
            turns[i].go_onward = counters + (i + 1) * sizeof(uint32_t);
        }
    }
}

/* Prepares the memory for paths that move between kernels. */
static int prepare_apart(struct path_run *r, struct kiln_error *error)
{
    struct vulkan_backend *b = r->b;
    const uint32_t fit = MOST_PATHS / (r->room > 0 ? r->room : 1);
    r->most_samples = r->most_samples < fit ? r->most_samples : fit;
    const uint64_t paths = (uint64_t)r->room * r->most_samples;
    const size_t bytes = TURNS * (sizeof(struct kiln_gpu_path_turn) + sizeof(uint32_t)) +
                         paths * (2 * sizeof(uint32_t) + sizeof(struct kiln_gpu_path_state));
    struct kiln_gpu_path_turn turns[TURNS];
    int status;
    KILN_TRY(vulkan_kernel_of(b, &diffuse_shader, false, 0, &r->diffuse, error));
    KILN_TRY(vulkan_kernel_of(b, &add_shader, false, TURNS, &r->clear, error));
    KILN_TRY(vulkan_kernel_of(b, &add_shader, false, 0, &r->add, error));
    KILN_TRY(gpu_buffer_create(b->gpu, &r->apart, bytes, GPU_DEVICE, "paths under way", error));
    describe_turns(r, paths, turns);
    KILN_TRY(gpu_upload(b->gpu, &r->apart, 0, turns, sizeof turns, error));
end:
    return status;
}

static int prepare(struct path_run *r, const struct kiln_path_parameters *c, const struct kiln_batch *batch,
                   struct kiln_error *error)
{
    struct vulkan_backend *b = r->b;
    const uint64_t seed = b->params.seed;
    r->room = (uint32_t)(batch->count < MOST_PIXELS ? batch->count : MOST_PIXELS);
    r->most_samples = gpu_about(b->gpu)->software ? MOST_SAMPLES_SOFTWARE : MOST_SAMPLES;
    if (batch->samples < r->most_samples)
        r->most_samples = batch->samples;
    int status;
    KILN_TRY(vulkan_surfaces(b, error));
    KILN_TRY(vulkan_kernel_of(b, &path_shader, false, 0, &r->kernel, error));
    KILN_TRY(gpu_buffer_create(b->gpu, &r->sums, r->room * sizeof(struct kiln_gpu_path_sums), GPU_HOST,
                               "the sums of pixels", error));
    KILN_TRY(kiln_allocate(&r->answers, r->room, sizeof *r->answers, "the answers of pixels", error));
end:
    r->push = (struct kiln_gpu_path_push){.scene = b->scene.address,
                                          .seed = kiln_hash2((uint32_t)seed, (uint32_t)(seed >> 32) ^ KILN_PATH_SEED),
                                          .width = c->width,
                                          .height = c->height,
                                          .bounces = c->bounces,
                                          .path_length = c->length,
                                          .orthographic = c->orthographic,
                                          .position = c->position,
                                          .forward = c->forward,
                                          .right = c->right,
                                          .up = c->up,
                                          .lens_radius = c->lens_radius,
                                          .focus_distance = c->focus_distance,
                                          .extent = b->params.geometry->extent};
    return status == KILN_OK && b->materials.gloss ? prepare_apart(r, error) : status;
}

static void finish(struct path_run *r)
{
    gpu_buffer_destroy(r->b->gpu, &r->sums);
    gpu_buffer_destroy(r->b->gpu, &r->apart);
    kiln_free(&r->answers);
}

/* Number of pixels to process at once: as many as fit, if a time slice suffices for one path of each. */
static uint32_t size_chunk(const struct path_run *r, size_t left)
{
    const uint64_t paths = gpu_pacer_next(&r->b->pacers[KILN_PASS_INDEX_path], FIRST_GUESS);
    const uint64_t some = paths < 64 ? 64 : paths < r->room ? paths : r->room; /* a workgroup at least */
    return (uint32_t)(some < left ? some : left);
}

static struct gpu_step step_of(struct gpu_kernel *kernel, uint32_t threads, const struct kiln_gpu_path_push *push)
{
    return (struct gpu_step){
        .kernel = kernel, .threads_x = threads, .threads_y = 1, .constants = push, .constant_bytes = sizeof *push};
}

/* Runs a dispatch's paths in scenes with gloss: kernels alternate, then their sums are added up. */
static int run_turns(struct path_run *r, double *seconds, struct kiln_error *error)
{
    const uint32_t paths = r->push.count * r->push.samples;
    struct kiln_gpu_path_push pushes[TURNS + 2];
    struct gpu_step steps[TURNS + 2];
    for (uint32_t i = 0; i < TURNS + 2; i++) {
        pushes[i] = r->push;
        pushes[i].turn = r->apart.address;
    }
    pushes[TURNS].turn = counters_of(r);
    steps[0] = step_of(r->clear, TURNS, &pushes[TURNS]);
    for (uint32_t i = 0; i < TURNS; i++) {
        pushes[i].turn += i * sizeof(struct kiln_gpu_path_turn);
        steps[1 + i] = step_of(i % 2 == 0 ? r->diffuse : r->kernel, paths, &pushes[i]);
    }
    steps[TURNS + 1] = step_of(r->add, r->push.count, &pushes[TURNS + 1]);
    return gpu_run(r->b->gpu, steps, TURNS + 2, seconds, error);
}

static int run_samples(struct path_run *r, uint32_t done, uint32_t left, struct kiln_error *error)
{
    struct gpu_pacer *pacer = &r->b->pacers[KILN_PASS_INDEX_path];
    const uint32_t most = r->most_samples;
    const uint64_t enough = gpu_pacer_next(pacer, FIRST_GUESS) / r->push.count;
    uint32_t some = enough < 1 ? 1 : enough < most ? (uint32_t)enough : most;
    r->push.first_sample = done;
    r->push.samples = some < left ? some : left;
    double seconds;
    const struct gpu_step step = step_of(r->kernel, r->push.count, &r->push);
    const int status = r->add != NULL ? run_turns(r, &seconds, error) : gpu_run(r->b->gpu, &step, 1, &seconds, error);
    if (status == KILN_OK)
        gpu_pacer_learn(pacer, (uint64_t)r->push.count * r->push.samples, seconds);
    return status;
}

int vulkan_read_path_sums(const struct vulkan_backend *b, const struct kiln_gpu_path_sums *sums, size_t count,
                          struct kiln_path_result *results, uint64_t *rays, struct kiln_error *error)
{
    uint64_t all = 0;
    bool stopped = false;
#pragma omp parallel for num_threads((int)b->threads) reduction(+ : all) reduction(|| : stopped) if (count > 1 << 14)
    for (size_t i = 0; i < count; i++) {
        const struct kiln_gpu_path_sums *s = &sums[i];
        stopped = stopped || s->count == KILN_GPU_PATH_STOPPED;
        for (int c = 0; c < 3; c++)
            results[i].radiance[c] = s->high[c] + s->low[c];
        results[i].square = s->high[3] + s->low[3];
        results[i].count = s->count;
        all += s->rays;
    }
    *rays += all;
    if (stopped) /* see `check` in chunks.c */
        return kiln_fail(error, KILN_NO_DEVICE,
                         "%s ends long loops early, and a path needs one; use another device or --backend embree",
                         gpu_about(b->gpu)->name);
    return KILN_OK;
}

static int run_chunk(struct path_run *r, const struct kiln_batch *left, uint64_t *rays, struct kiln_error *error)
{
    const size_t bytes = r->push.count * sizeof(struct kiln_gpu_path_sums),
                 place = gpu_buffer_tail(r->b->gpu, &r->sums, bytes);
    struct kiln_gpu_path_sums *sums = (struct kiln_gpu_path_sums *)((char *)r->sums.mapped + place);
    r->push.sums = r->sums.address + place;
    r->push.index = left->first;
    memset(sums, 0, bytes);
    int status = KILN_OK;
    for (uint32_t done = 0; done < left->samples && status == KILN_OK; done += r->push.samples)
        status = run_samples(r, left->first_sample + done, left->samples - done, error);
    return status == KILN_OK ? vulkan_read_path_sums(r->b, sums, r->push.count, r->answers, rays, error) : status;
}

/* Runs the rest of the batch until it is done or fails; `left` becomes the part not taken. `refused`: the taker failed,
 * not the device. */
static int run_left(struct vulkan_backend *b, const void *parameters, struct kiln_batch *left, uint64_t *rays,
                    bool *refused, struct kiln_error *error)
{
    struct path_run r = {.b = b};
    int status = prepare(&r, parameters, left, error);
    while (left->count > 0 && status == KILN_OK) {
        const uint32_t pixels = r.push.count = size_chunk(&r, left->count);
        status = run_chunk(&r, left, rays, error);
        if (status == KILN_OK) {
            status = left->take != NULL ? left->take(left->context, left->first, pixels, r.answers, error) : KILN_OK;
            *refused = status != KILN_OK;
            *left = kiln_batch_range(left, left->first + pixels, left->count - pixels);
        }
    }
    finish(&r);
    return status;
}

static int run(struct vulkan_backend *b, const void *parameters, const struct kiln_batch *batch, uint64_t *rays,
               struct kiln_error *error)
{
    return vulkan_run_to_end(b, run_left, parameters, batch, rays, error);
}

const struct vulkan_pass vulkan_pass_path = {.run = run};
