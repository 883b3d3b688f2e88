/* The land pass (worker/pass/land.h): shaders/land.comp traces a slice of time's paths at once, while answers of those
 * before are taken over. Results do not depend on how many these are. */
#include <stdint.h> /* before the shaders */

#include "shaders/land.h"
#include "shaders/land_float.h"
#include "shaders/shared/land.h"
#include "worker/backend/vulkan/chunks.h"
#include "worker/base/memory.h"
#include "worker/light/aims.h"
#include "worker/pass/land.h"
#include "worker/pass/weighed.h"
#include "worker/store/landing.h"

static const struct vulkan_shader land_shader = {
    .name = "light paths that land", .compute = VULKAN_CODE(land), .compute_float = VULKAN_CODE(land_float)};

/* The kernel's own constant. */
enum { WHOLE, SHARED };
/* Paths of a dispatch, at most; of a thread (of a GPU, so that those with few surfaces do not wait for those with many)
 * and threads that fill one; where the pacer begins. */
enum { MOST_PATHS = 1 << 20, PATHS_A_THREAD = 8, THREADS = 1 << 18, FIRST_GUESS = 1 << 15, LEAST = 64 };
/* Dispatches that a batch is cut into, unless they would not fill a GPU: the answers of one are taken over while the
 * next is traced. */
enum { DISPATCHES = 4 };

/* Paths that are under way in a slot. */
struct portion {
    size_t first, count; /* count 0: none */
};

/* A call's working set. */
struct land_run {
    struct vulkan_backend *b;
    struct gpu_kernel *kernel;
    struct kiln_store store;
    struct portion portions[2];
    size_t room; /* paths of a portion */
    struct kiln_land_result *results;
    uint64_t rays;
    const struct kiln_aims *aims;
    bool shares;
};

/* ---- answers ---- */

/* `aim`: of the path before it; becomes that of this one. */
static void read_landing(const struct land_run *r, const struct kiln_gpu_landing *l, uint64_t path, size_t *aim,
                         struct kiln_land_result *result)
{
    *aim = kiln_aims_find_next(r->aims, path % r->aims->paths, *aim);
    const uint32_t length = l->end >> KILN_GPU_LAND_LENGTH;
    *result = (struct kiln_land_result){.point = KILN_NO_POINT,
                                        .flux = {l->flux[0], l->flux[1], l->flux[2]},
                                        .shading = l->shading,
                                        .taken_up = l->taken_up,
                                        .others = l->others,
                                        .aim = (uint32_t)*aim,
                                        .end = (uint16_t)(l->end & KILN_GPU_LAND_END),
                                        .length = (uint16_t)length};
    if (r->shares)
        result->sampled = l->sampled;
    if (result->end == KILN_LAND_LANDED && l->triangle != KILN_GPU_NONE)
        result->point = kiln_store_landing(&r->store, l->triangle & ~KILN_GPU_BOTH_BACK, l->u, l->v,
                                           (l->triangle & KILN_GPU_BOTH_BACK) != 0);
}

/* Waits for a portion and takes its answers over. */
static int take_over(struct land_run *r, uint32_t slot, struct kiln_error *error)
{
    const struct portion *p = &r->portions[slot];
    struct vulkan_backend *b = r->b;
    double seconds;
    int status = gpu_wait(b->gpu, slot, &seconds, error);
    if (status != KILN_OK)
        return status;
    gpu_pacer_learn(&b->pacers[KILN_PASS_INDEX_land], p->count, seconds);
    const struct kiln_gpu_landing *landings = b->slots[slot].host.mapped;
    uint64_t rays = 0, stopped = 0;
    size_t aim = 0;
#pragma omp parallel for num_threads((int)b->threads) reduction(+ : rays, stopped) firstprivate(aim) if (p->count > \
                                                                                                           1 << 14)
    for (size_t i = 0; i < p->count; i++) {
        const uint32_t end = landings[i].end;
        rays += (end >> KILN_GPU_LAND_LENGTH) + ((end & KILN_GPU_LAND_MISSED) != 0 ? 1 : 0);
        stopped += (end & KILN_GPU_LAND_STOPPED) != 0;
        read_landing(r, &landings[i], (uint64_t)p->first + i, &aim, &r->results[i]);
    }
    if (stopped > 0)
        return kiln_fail(error, KILN_NO_DEVICE,
                         "%s ends long loops early, and a light path needs one; use another device or --backend embree",
                         gpu_about(b->gpu)->name);
    r->rays += rays;
    return KILN_OK;
}

/* ---- running ---- */

static int prepare(struct land_run *r, const struct kiln_land_parameters *p, size_t count, struct kiln_error *error)
{
    struct vulkan_backend *b = r->b;
    r->aims = p->aims;
    r->shares = p->techniques != NULL && kiln_mis_has_factors(p->techniques->mis);
    const size_t part = count / DISPATCHES + 1, filling = part > THREADS ? part : THREADS;
    r->room = count < filling ? count : filling < MOST_PATHS ? filling : MOST_PATHS;
    kiln_store_build(&r->store, b->surface, b->params.geometry);
    int status = vulkan_surfaces(b, error);
    if (status == KILN_OK)
        status = vulkan_kernel_of(b, &land_shader, false, p->techniques != NULL ? SHARED : WHOLE, &r->kernel, error);
    if (status == KILN_OK)
        status = vulkan_techniques_create(b, p->aims, p->techniques, error);
    for (int i = 0; i < 2 && status == KILN_OK; i++) {
        const size_t bytes = r->room * sizeof(struct kiln_gpu_landing);
        status = vulkan_grow_buffer(b, &b->slots[i].answers, bytes, GPU_DEVICE, "light paths", error);
        if (status == KILN_OK)
            status = vulkan_grow_buffer(b, &b->slots[i].host, bytes, GPU_HOST, "light paths", error);
    }
    if (status == KILN_OK)
        status = kiln_allocate(&r->results, r->room, sizeof *r->results, "the answers of light paths", error);
    return status;
}

static void finish(struct land_run *r)
{
    for (uint32_t i = 0; i < 2; i++)
        if (r->portions[i].count > 0)
            (void)gpu_wait(r->b->gpu, i, NULL, NULL);
    vulkan_techniques_release(r->b);
    kiln_free(&r->results);
}

/* As many threads as paths on a software device, which ends a thread's loops after 65,535 rounds in all. */
static uint32_t threads_for(const struct vulkan_backend *b, size_t paths)
{
    const size_t fewer = (paths + PATHS_A_THREAD - 1) / PATHS_A_THREAD, some = fewer > THREADS ? fewer : THREADS;
    return (uint32_t)(gpu_about(b->gpu)->software || paths < some ? paths : some);
}

/* Hands paths from `first` on, `left` at most, to the device. */
static int begin_portion(struct land_run *r, uint32_t slot, size_t first, size_t left, struct kiln_error *error)
{
    struct vulkan_backend *b = r->b;
    struct portion *p = &r->portions[slot];
    const uint64_t enough = gpu_pacer_next(&b->pacers[KILN_PASS_INDEX_land], FIRST_GUESS), most = r->room,
                   some = enough < LEAST ? LEAST : enough;
    const size_t count = (size_t)(some < most ? some : most);
    p->first = first;
    p->count = count < left ? count : left;
    const struct kiln_gpu_land_push push = {
        .scene = b->scene.address,
        .both = b->techniques.both,
        .results = b->slots[slot].answers.address,
        .index = first,
        .count = (uint32_t)p->count,
        .threads = threads_for(b, p->count),
        .seed = kiln_hash2((uint32_t)b->params.seed, (uint32_t)(b->params.seed >> 32) ^ KILN_LAND_SEED)};
    const struct gpu_step steps[2] = {{.kernel = r->kernel,
                                       .threads_x = push.threads,
                                       .threads_y = 1,
                                       .constants = &push,
                                       .constant_bytes = sizeof push},
                                      {.from = &b->slots[slot].answers,
                                       .to = &b->slots[slot].host,
                                       .size = p->count * sizeof(struct kiln_gpu_landing)}};
    const int status = gpu_submit(b->gpu, slot, steps, 2, error);
    if (status != KILN_OK)
        p->count = 0;
    return status;
}

/* Takes what a slot has been at work on, and gives it to the caller. */
static int end_portion(struct land_run *r, uint32_t slot, struct kiln_batch *left, uint64_t *rays, bool *refused,
                       struct kiln_error *error)
{
    struct portion *p = &r->portions[slot];
    const size_t count = p->count;
    const uint64_t before = r->rays;
    int status = take_over(r, slot, error);
    p->count = 0;
    if (status != KILN_OK)
        return status;
    *rays += r->rays - before;
    status = left->take != NULL ? left->take(left->context, left->first, count, r->results, error) : KILN_OK;
    *refused = status != KILN_OK;
    *left = kiln_batch_part(left, left->first + count, left->count - count);
    return status;
}

static int run_left(struct vulkan_backend *b, const void *parameters, struct kiln_batch *left, uint64_t *rays,
                    bool *refused, struct kiln_error *error)
{
    struct land_run r = {.b = b};
    const size_t end = left->first + left->count;
    size_t next = left->first;
    int status = prepare(&r, parameters, left->count, error);
    for (uint32_t slot = 0; left->count > 0 && status == KILN_OK; slot ^= 1) {
        if (next < end)
            status = begin_portion(&r, slot, next, end - next, error);
        next += status == KILN_OK ? r.portions[slot].count : 0;
        if (status == KILN_OK && r.portions[slot ^ 1].count > 0)
            status = end_portion(&r, slot ^ 1, left, rays, refused, error);
    }
    finish(&r);
    return status;
}

static int run(struct vulkan_backend *b, const void *parameters, const struct kiln_batch *batch, uint64_t *rays,
               struct kiln_error *error)
{
    return vulkan_run_to_end(b, run_left, parameters, batch, rays, error);
}

/* Spheres of probes ask for walls (worker/pass/spheres.h), of an image of the sky there is only one cell here
 * (worker/light/sky_cells.h), and the kernel has no form for the ray-tracing pipeline. */
static bool takes(const struct vulkan_backend *b, const void *parameters)
{
    const struct kiln_land_parameters *p = parameters;
    return p->spheres == NULL && (p->aims == NULL || p->aims->sky.count <= 1) && b->tracer.acceleration == NULL;
}

const struct vulkan_pass vulkan_pass_land = {.run = run, .takes = takes};
