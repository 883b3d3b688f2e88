/* The probe pass (worker/pass/probes.h): shaders/probes.comp computes slices of each probe's samples, rays first and
 * then light samples, probes_reduce.comp sums them up. A chunk has as many probes as a time slice and the memory for
 * partial sums allow; for few probes with many samples, slices are computed in portions. Neither affects the order of
 * sums, so results do not depend on it. For groups of lights, the result of each ray is kept, and probes_groups.comp
 * sums these up. */
#include <stdint.h> /* before the shaders */
#include <string.h>

#include "shaders/shared/layout_probe.h"
#include "shaders/shared/light_importance.h"
#include "shaders/shared/streams.h"
#include "worker/backend/vulkan/groups.h"
#include "worker/base/memory.h"
#include "worker/pass/probes.h"

static const struct vulkan_shader gloss_shader = {.name = "probes with gloss",
                                                  .compute = VULKAN_CODE(probes_gloss),
                                                  .pipeline = VULKAN_CODE(probes_gloss_pipeline),
                                                  .compute_float = VULKAN_CODE(probes_gloss_float),
                                                  .pipeline_float = VULKAN_CODE(probes_gloss_pipeline_float)};
static const struct vulkan_shader probes_shader = {.name = "probes",
                                                   .compute = VULKAN_CODE(probes),
                                                   .pipeline = VULKAN_CODE(probes_pipeline),
                                                   .compute_float = VULKAN_CODE(probes_float),
                                                   .pipeline_float = VULKAN_CODE(probes_pipeline_float),
                                                   .gloss = &gloss_shader};
/* light samples, which no chain begins at: the same for all materials */
static const struct vulkan_shader lights_shader = {.name = "probes: lights",
                                                   .compute = VULKAN_CODE(probes),
                                                   .pipeline = VULKAN_CODE(probes_pipeline),
                                                   .compute_float = VULKAN_CODE(probes_float),
                                                   .pipeline_float = VULKAN_CODE(probes_pipeline_float)};
static const struct vulkan_shader reduce_shader = {.name = "probes_reduce", .compute = VULKAN_CODE(probes_reduce)};

static const struct vulkan_shader groups_shader = {.name = "probes: groups", .compute = VULKAN_CODE(probes_groups)};

enum { FIRST_GUESS = 1 << 14, SLICE_BYTES = KILN_GPU_PROBE_FLOATS * sizeof(float) };
static const uint64_t most_scratch = (uint64_t)64 << 20; /* bytes of partial sums */

_Static_assert(KILN_GPU_PROBE_GROUP_FLOATS == KILN_GROUP_PROBE_FLOATS, "groups are answered as they are");
_Static_assert(sizeof(struct kiln_probe_result) == SLICE_BYTES - sizeof(float),
               "a probe's answer on the device ends with the shadow rays");

/* A call's working set. */
struct probes_run {
    struct vulkan_backend *b;
    struct gpu_kernel *rays, *lights, *reduce, *groups;
    struct gpu_buffer positions, slices, results;
    struct gpu_buffer found, group_results; /* where groups are told apart */
    struct kiln_probe_result *answers;      /* of a chunk, for the taker */
    uint32_t room;                          /* probes that fit into the buffers and `answers` */
    struct kiln_gpu_probes_push push;
};

/* Bytes per probe for ray results and light of groups; 0: no groups. */
static size_t found_bytes(const struct probes_run *r)
{
    return vulkan_groups_count(r->b) == 0 ? 0
                                          : r->push.samples * KILN_GPU_PROBE_FOUND_BYTES +
                                                r->push.lights * KILN_GPU_PROBE_LIGHT_BYTES + sizeof(uint32_t);
}

static size_t group_bytes(const struct probes_run *r)
{
    return vulkan_groups_count(r->b) * KILN_GROUP_PROBE_FLOATS * sizeof(float);
}

static int make_group_room(struct probes_run *r, struct kiln_error *error)
{
    const int status = gpu_buffer_create(r->b->gpu, &r->found, r->room * found_bytes(r), GPU_DEVICE,
                                         "what rays of probes have found", error);
    return status == KILN_OK ? gpu_buffer_create(r->b->gpu, &r->group_results, r->room * group_bytes(r), GPU_HOST,
                                                 "the light of groups at probes", error)
                             : status;
}

static int make_room(struct probes_run *r, size_t count, struct kiln_error *error)
{
    struct gpu *gpu = r->b->gpu;
    const uint64_t a_probe = (uint64_t)r->push.slice_count * SLICE_BYTES + found_bytes(r) + group_bytes(r);
    const uint64_t scratch = most_scratch < r->b->scratch_most ? most_scratch : r->b->scratch_most;
    const uint64_t fitting = scratch / a_probe < 1 ? 1 : scratch / a_probe;
    r->room = (uint32_t)(count < fitting ? count : fitting);
    int status;
    KILN_TRY(gpu_buffer_create(gpu, &r->slices, (size_t)r->room * r->push.slice_count * SLICE_BYTES, GPU_DEVICE,
                               "the probes' partial sums", error));
    KILN_TRY(gpu_buffer_create(gpu, &r->positions, r->room * sizeof(struct kiln_vec3), GPU_HOST,
                               "the probes' positions", error));
    KILN_TRY(
        gpu_buffer_create(gpu, &r->results, (size_t)r->room * SLICE_BYTES, GPU_HOST, "the probes' answers", error));
    KILN_TRY(kiln_allocate(&r->answers, r->room, sizeof *r->answers, "the probes' answers", error));
end:
    return status == KILN_OK && vulkan_groups_count(r->b) > 0 ? make_group_room(r, error) : status;
}

static int prepare_groups(struct probes_run *r, struct kiln_error *error)
{
    struct vulkan_backend *b = r->b;
    int status;
    KILN_TRY(vulkan_kernel_of(b, &groups_shader, false, 0, &r->groups, error));
    KILN_TRY(vulkan_groups_of_lights(b, error));
    KILN_TRY(vulkan_groups_radiosity(b, error));
end:
    return status;
}

static int prepare(struct probes_run *r, const struct kiln_probe_parameters *settings, size_t count, uint32_t samples,
                   struct kiln_error *error)
{
    struct vulkan_backend *b = r->b;
    const struct kiln_geometry *g = b->params.geometry;
    const uint64_t seed = b->params.seed;
    const bool groups = vulkan_groups_count(b) > 0;
    int status;
    const uint32_t grouped = groups ? KILN_GPU_PROBE_GROUPED : 0;
    KILN_TRY(vulkan_kernel_of(b, &probes_shader, false, KILN_GPU_PROBE_RAYS | grouped, &r->rays, error));
    KILN_TRY(vulkan_kernel_of(b, &lights_shader, false, KILN_GPU_PROBE_LIGHTS | grouped, &r->lights, error));
    KILN_TRY(vulkan_kernel_of(b, &reduce_shader, false, 0, &r->reduce, error));
    KILN_TRY(vulkan_sobol(b, samples + 1, error)); /* a single light gets all samples, rounded up at most */
    if (groups)
        KILN_TRY(prepare_groups(r, error));
end:
    r->push =
        (struct kiln_gpu_probes_push){.scene = b->scene.address,
                                      .sobol = b->sobol.address,
                                      .sobol_stride = b->sobol_count,
                                      .samples = samples,
                                      .slice_count = (samples - 1) / KILN_GPU_PROBE_SAMPLES + 1,
                                      .seed = kiln_hash2((uint32_t)seed, (uint32_t)(seed >> 32) ^ KILN_PROBE_SEED),
                                      .far = vec3_length(vec3_sub(g->bounds_max, g->bounds_min)),
                                      .leaves = settings->leaves};
    if (groups) /* the samples of each choice are rounded up at most */
        r->push.lights = samples + KILN_CUT_MAX + (uint32_t)b->params.lights->directional_count + 1;
    return status == KILN_OK ? make_room(r, count, error) : status;
}

static void finish(struct probes_run *r)
{
    gpu_buffer_destroy(r->b->gpu, &r->slices);
    gpu_buffer_destroy(r->b->gpu, &r->positions);
    gpu_buffer_destroy(r->b->gpu, &r->results);
    gpu_buffer_destroy(r->b->gpu, &r->found);
    gpu_buffer_destroy(r->b->gpu, &r->group_results);
    kiln_free(&r->answers);
}

/* Offset in the buffer of the groups' light, for push.count probes. */
static size_t group_place(const struct probes_run *r)
{
    return gpu_buffer_tail(r->b->gpu, &r->group_results, r->push.count * group_bytes(r));
}

/* Computes slices [push.slice_first, + rows) of push.count probes; also the answers, if these are the last slices. */
static int run_rows(struct probes_run *r, uint32_t rows, struct kiln_error *error)
{
    const struct kiln_gpu_probes_push *p = &r->push;
    struct gpu_pacer *pacer = &r->b->pacers[KILN_PASS_INDEX_probes];
    const uint64_t results =
        r->results.address + gpu_buffer_tail(r->b->gpu, &r->results, (size_t)p->count * SLICE_BYTES);
    const struct kiln_gpu_probes_reduce_push reduce = {
        .scene = p->scene, .slices = p->slices, .results = results, .count = p->count, .slice_count = p->slice_count};
    const struct kiln_gpu_probe_groups_push groups = {.scene = p->scene,
                                                      .found = p->found,
                                                      .radiosity = r->b->group_lights.address,
                                                      .results = r->group_results.address + group_place(r),
                                                      .count = p->count,
                                                      .samples = p->samples,
                                                      .lights = p->lights,
                                                      .groups = vulkan_groups_count(r->b)};
    const struct gpu_step steps[] = {
        {.kernel = r->rays, .threads_x = p->count, .threads_y = rows, .constants = p, .constant_bytes = sizeof *p},
        {.kernel = r->lights, .threads_x = p->count, .threads_y = rows, .constants = p, .constant_bytes = sizeof *p},
        {.kernel = r->reduce,
         .threads_x = p->count,
         .threads_y = KILN_GPU_PROBE_FLOATS,
         .constants = &reduce,
         .constant_bytes = sizeof reduce},
        {.kernel = r->groups,
         .threads_x = p->count,
         .threads_y = groups.groups,
         .constants = &groups,
         .constant_bytes = sizeof groups},
    };
    const size_t all = groups.groups > 0 ? 4 : 3;
    double seconds;
    const int status = gpu_run(r->b->gpu, steps, p->slice_first + rows == p->slice_count ? all : 2, &seconds, error);
    if (status == KILN_OK)
        gpu_pacer_learn(pacer, (uint64_t)p->count * rows * KILN_GPU_PROBE_SAMPLES, seconds);
    return status;
}

/* Finds how many probes fit into a time slice, and how many slices of each. */
static void size_chunk(const struct probes_run *r, size_t left, uint32_t *probes, uint32_t *rows)
{
    const uint64_t slices = gpu_pacer_next(&r->b->pacers[KILN_PASS_INDEX_probes], FIRST_GUESS) / KILN_GPU_PROBE_SAMPLES;
    uint64_t some = slices / r->push.slice_count;
    some = some < 64 ? 64 : some; /* a workgroup */
    some = some < r->room ? some : r->room;
    *probes = (uint32_t)(some < left ? some : left);
    const uint64_t portion = slices / *probes < 1 ? 1 : slices / *probes;
    *rows = (uint32_t)(portion < r->push.slice_count ? portion : r->push.slice_count);
}

static int run_chunk(struct probes_run *r, const struct kiln_vec3 *positions, uint32_t count, uint32_t rows,
                     struct kiln_error *error)
{
    r->push.count = count;
    const struct gpu *gpu = r->b->gpu;
    const size_t place = gpu_buffer_tail(gpu, &r->positions, count * sizeof *positions);
    r->push.positions = r->positions.address + place;
    r->push.slices =
        r->slices.address + gpu_buffer_tail(gpu, &r->slices, (size_t)count * r->push.slice_count * SLICE_BYTES);
    gpu_buffer_forget(gpu, &r->slices);
    if (r->groups != NULL)
        r->push.found = r->found.address + gpu_buffer_tail(gpu, &r->found, count * found_bytes(r));
    memcpy((char *)r->positions.mapped + place, positions, count * sizeof *positions);
    int status = KILN_OK;
    for (uint32_t first = 0; first < r->push.slice_count && status == KILN_OK; first += rows) {
        r->push.slice_first = first;
        status = run_rows(r, r->push.slice_count - first < rows ? r->push.slice_count - first : rows, error);
    }
    return status;
}

/* See `check` in chunks.c. */
static int fail_early(const struct probes_run *r, struct kiln_error *error)
{
    return kiln_fail(error, KILN_NO_DEVICE,
                     "%s ends long loops early, and a probe needs one; use another device or --backend embree",
                     gpu_about(r->b->gpu)->name);
}

/* Reads the light of groups, for the probes from `first` on. */
static int read_groups(const struct probes_run *r, uint64_t first, uint32_t count, struct kiln_error *error)
{
    struct kiln_groups *g = r->b->base.given.groups;
    const size_t floats = group_bytes(r) / sizeof(float);
    if (g == NULL)
        return KILN_OK;
    g->first = first;
    const int status =
        kiln_grow(&g->answers, &g->room, count * floats, sizeof *g->answers, "the light of groups at probes", error);
    if (status == KILN_OK)
        memcpy(g->answers, (const char *)r->group_results.mapped + group_place(r), count * group_bytes(r));
    for (size_t i = 0; status == KILN_OK && i < count * floats; i += KILN_GROUP_PROBE_FLOATS)
        if (g->answers[i] < 0.0f)
            return fail_early(r, error);
    return status;
}

/* Copies a chunk's answers out of the device's memory and adds up their rays. */
static int read_answers(struct probes_run *r, uint32_t count, uint64_t *rays, struct kiln_error *error)
{
    const float *answers = (const float *)r->results.mapped +
                           gpu_buffer_tail(r->b->gpu, &r->results, (size_t)count * SLICE_BYTES) / sizeof *answers;
    for (size_t i = 0; i < count; i++, answers += KILN_GPU_PROBE_FLOATS) {
        memcpy(&r->answers[i], answers, sizeof *r->answers);
        if (r->answers[i].mean_distance < 0.0f)
            return fail_early(r, error);
        *rays += r->push.samples + (uint64_t)answers[KILN_GPU_PROBE_FLOATS - 1];
    }
    return KILN_OK;
}

/* Runs the rest of the batch until it is done or fails; `left` becomes the part not taken. `refused`: the taker failed,
 * not the device. */
static int run_left(struct vulkan_backend *b, const void *parameters, struct kiln_batch *left, uint64_t *rays,
                    bool *refused, struct kiln_error *error)
{
    struct probes_run r = {.b = b};
    int status = prepare(&r, parameters, left->count, left->samples, error);
    while (left->count > 0 && status == KILN_OK) {
        uint32_t probes, rows;
        size_chunk(&r, left->count, &probes, &rows);
        r.push.index = left->first;
        status = run_chunk(&r, left->positions, probes, rows, error);
        if (status == KILN_OK)
            status = read_answers(&r, probes, rays, error);
        if (status == KILN_OK)
            status = read_groups(&r, left->first, probes, error);
        if (status == KILN_OK) {
            status = left->take != NULL ? left->take(left->context, left->first, probes, r.answers, error) : KILN_OK;
            *refused = status != KILN_OK;
            *left = kiln_batch_range(left, left->first + probes, left->count - probes);
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

const struct vulkan_pass vulkan_pass_probes = {.run = run,
                                               .ahead = {{.shader = &probes_shader, .own = KILN_GPU_PROBE_RAYS},
                                                         {.shader = &lights_shader, .own = KILN_GPU_PROBE_LIGHTS},
                                                         {.shader = &reduce_shader}}};
