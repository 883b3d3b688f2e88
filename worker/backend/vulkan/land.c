/* The land pass (worker/pass/land.h): the kernels of shaders/land.glsl trace as many paths as fit into a time slice,
 * surface by surface, while the answers of earlier ones are processed. Results do not depend on the number of paths at
 * once. */
#include <stdint.h> /* before the shaders */

#include "shaders/shared/land.h"
#include "worker/backend/vulkan/bidirectional.h"
#include "worker/backend/vulkan/spheres.h"
#include "worker/base/memory.h"
#include "worker/light/aims.h"
#include "worker/pass/land.h"
#include "worker/pass/weighed.h"

/* MOST_PATHS: active paths; FIRST_GUESS: where the pacer begins. */
enum { MOST_PATHS = 1 << 20, FIRST_GUESS = 1 << 15, LEAST = 64 };
/* A batch is divided into PORTIONS portions, unless each would have fewer than FILLING paths, which fill a GPU: answers
 * of one portion are processed while the next is traced. */
enum { PORTIONS = 4, FILLING = 1 << 18 };

/* Paths whose answers are being transferred to the host. */
struct portion {
    size_t first, count; /* count 0: none */
};

/* A call's working set. */
struct land_run {
    struct vulkan_backend *b;
    struct both_run *paths; /* b->both */
    struct portion portions[2];
    size_t room;                      /* paths of a portion */
    struct kiln_land_result *results; /* is b->results, which is reused: allocating takes as long as half the paths */
    uint64_t rays;
    const struct kiln_aims *aims;
    /* spheres that collect the light of paths, instead of landings; NULL: paths land */
    const struct kiln_probe_spheres *spheres;
    struct gpu_pacer *pacer;
};

/* ---- answers ---- */

/* Reads the result of a path. `aim`: in: of the path before; out: of this one. */
static void read_landing(const struct land_run *r, const struct kiln_gpu_landing *l, uint64_t path, size_t *aim,
                         struct kiln_land_result *result)
{
    *aim = kiln_aims_find_next(r->aims, path % r->aims->paths, *aim);
    const uint32_t length = l->end >> KILN_GPU_LAND_LENGTH;
    *result = (struct kiln_land_result){.point = (uint64_t)l->point_high << 32 | l->point_low,
                                        .flux = {l->flux[0], l->flux[1], l->flux[2]},
                                        .shading = l->shading,
                                        .taken_up = l->taken_up,
                                        .others = l->others,
                                        .aim = (uint32_t)*aim,
                                        .end = (uint16_t)(l->end & KILN_GPU_LAND_END),
                                        .length = (uint16_t)length};
}

/* Waits for a portion's answers, and reads them. */
static int take_over(struct land_run *r, uint32_t slot, struct kiln_error *error)
{
    const struct portion *p = &r->portions[slot];
    struct vulkan_backend *b = r->b;
    const int status = gpu_wait(b->gpu, slot, NULL, error);
    if (status != KILN_OK)
        return status;
    const struct kiln_gpu_landing *landings = b->slots[slot].host.mapped;
    uint64_t rays = 0;
    size_t aim = 0;
#pragma omp parallel for num_threads((int)b->threads) reduction(+ : rays) firstprivate(aim) if (p->count > 1 << 14)
    for (size_t i = 0; i < p->count; i++) {
        const uint32_t end = landings[i].end;
        rays += (end >> KILN_GPU_LAND_LENGTH) + ((end & KILN_GPU_LAND_MISSED) != 0 ? 1 : 0);
        if (r->spheres == NULL)
            read_landing(r, &landings[i], (uint64_t)p->first + i, &aim, &r->results[i]);
    }
    r->rays += rays;
    return KILN_OK;
}

/* ---- running ---- */

/* Prepares b->both for `count` paths at once: reuses that of the call before if it has as many slots, else makes a new
 * one. */
static int prepare_paths(struct land_run *r, size_t count, bool shares, struct kiln_error *error)
{
    struct vulkan_backend *b = r->b;
    const size_t part = count / PORTIONS + 1, filling = part > FILLING ? part : FILLING,
                 most = filling < MOST_PATHS ? filling : MOST_PATHS, wanted = count < most ? count : most;
    const bool there = b->both != NULL && b->both->method == KILN_GPU_BOTH_LANDS && b->both->count >= wanted;
    int status = KILN_OK;
    if (!there) {
        vulkan_bidirectional_release(b);
        status = kiln_allocate(&b->both, 1, sizeof *b->both, "paths under way", error);
        if (status != KILN_OK)
            return status;
        *b->both = (struct both_run){.b = b, .method = KILN_GPU_BOTH_LANDS, .count = wanted};
    }
    r->paths = b->both;
    r->paths->shares = shares;
    r->paths->crosses = r->spheres != NULL;
    r->room = wanted;
    return there ? both_kernels(r->paths, error) : both_stages_create(r->paths, error);
}

/* Room for the answers of a slot's paths. */
static int make_room(struct land_run *r, struct kiln_error *error)
{
    struct vulkan_backend *b = r->b;
    const size_t bytes = r->room * sizeof(struct kiln_gpu_landing);
    int status = KILN_OK;
    for (int i = 0; i < 2; i++) {
        KILN_TRY(vulkan_grow_buffer(b, &b->slots[i].answers, bytes, GPU_DEVICE, "light paths", error));
        KILN_TRY(vulkan_grow_buffer(b, &b->slots[i].host, bytes, GPU_HOST, "light paths", error));
    }
    KILN_TRY(
        kiln_grow(&b->results, &b->result_room, r->room * sizeof *r->results, 1, "the answers of light paths", error));
end:
    r->results = (struct kiln_land_result *)(void *)b->results;
    return status;
}

static int prepare(struct land_run *r, const struct kiln_land_parameters *p, size_t count, struct kiln_error *error)
{
    struct vulkan_backend *b = r->b;
    r->aims = p->aims;
    r->spheres = p->spheres;
    r->pacer = &b->pacers[r->spheres != NULL ? (size_t)VULKAN_PACE_SPHERES : (size_t)KILN_PASS_INDEX_land];
    int status = vulkan_surfaces(b, error);
    if (status == KILN_OK)
        status = prepare_paths(r, count, p->techniques != NULL, error);
    if (status != KILN_OK)
        return status;
    struct both_run *paths = r->paths;
    r->room = paths->slots < r->room ? paths->slots : r->room;
    status = both_make_zeros(paths, &paths->counts, sizeof(struct kiln_gpu_both_counts), "counts of paths", error);
    paths->shared.counts = paths->counts.address;
    if (status == KILN_OK && r->spheres != NULL)
        status = vulkan_spheres_create(paths, p->aims, r->spheres, error);
    if (status == KILN_OK)
        status = vulkan_techniques_create(b, p->aims, p->techniques, &paths->shared, error);
    paths->push.scene = b->scene.address;
    paths->push.both = b->techniques.both;
    paths->push.seed = kiln_hash2((uint32_t)b->params.seed, (uint32_t)(b->params.seed >> 32) ^ KILN_LAND_SEED);
    return status == KILN_OK ? make_room(r, error) : status;
}

static void finish(struct land_run *r, int status)
{
    for (uint32_t i = 0; i < 2; i++)
        if (r->portions[i].count > 0)
            (void)gpu_wait(r->b->gpu, i, NULL, NULL);
    vulkan_techniques_release(r->b);
    vulkan_spheres_release(r->b);
    if (status != KILN_OK)
        vulkan_bidirectional_release(r->b);
}

/* Submits the paths from `first` on, at most `left`. */
static int begin_portion(struct land_run *r, uint32_t slot, size_t first, size_t left, struct kiln_error *error)
{
    struct portion *p = &r->portions[slot];
    const uint64_t enough = gpu_pacer_next(r->pacer, FIRST_GUESS), most = r->room,
                   some = enough < LEAST ? LEAST : enough;
    const size_t count = (size_t)(some < most ? some : most);
    p->first = first;
    p->count = count < left ? count : left;
    r->paths->push.pixel = first;
    r->paths->push.sums = r->b->slots[slot].answers.address;
    const int status = both_begin_landings(r->paths, slot, (uint32_t)p->count, error);
    if (status != KILN_OK)
        p->count = 0;
    return status;
}

/* Follows the paths of a portion to their ends, and starts the transfer of their answers. */
static int follow_portion(struct land_run *r, uint32_t slot, struct kiln_error *error)
{
    struct vulkan_backend *b = r->b;
    struct portion *p = &r->portions[slot];
    struct kiln_gpu_both_counts counts;
    const struct gpu_step copy = {.aside = true,
                                  .from = &b->slots[slot].answers,
                                  .to = &b->slots[slot].host,
                                  .size = p->count * sizeof(struct kiln_gpu_landing)};
    double seconds;
    int status;
    KILN_TRY(both_wait_for_landings(r->paths, slot, &seconds, error));
    gpu_pacer_learn(r->pacer, p->count, seconds);
    KILN_TRY(both_read_counts(r->paths, &counts, error));
    KILN_TRY(gpu_submit(b->gpu, slot, &copy, 1, error));
end:
    return status;
}

/* Reads the answers of a slot, and passes them to the caller. */
static int end_portion(struct land_run *r, uint32_t slot, struct kiln_batch *left, uint64_t *rays, bool *refused,
                       struct kiln_error *error)
{
    struct portion *p = &r->portions[slot];
    const size_t count = p->count;
    const uint64_t before = r->rays;
    int status = take_over(r, slot, error);
    p->count = 0;
    if (status != KILN_OK || r->spheres != NULL)
        return status;
    *rays += r->rays - before;
    status = left->take != NULL ? left->take(left->context, left->first, count, r->results, error) : KILN_OK;
    *refused = status != KILN_OK;
    *left = kiln_batch_range(left, left->first + count, left->count - count);
    return status;
}

/* Adds the light of all paths to the spheres at once: if the device was lost before, nothing has been added. */
static int end_spheres(struct land_run *r, struct kiln_batch *left, uint64_t *rays, struct kiln_error *error)
{
    const int status = vulkan_spheres_add(r->b, r->aims, r->spheres, &r->rays, error);
    if (status != KILN_OK)
        return status;
    *rays += r->rays;
    *left = kiln_batch_range(left, left->first + left->count, 0);
    return KILN_OK;
}

static int run_left(struct vulkan_backend *b, const void *parameters, struct kiln_batch *left, uint64_t *rays,
                    bool *refused, struct kiln_error *error)
{
    struct land_run r = {.b = b};
    const size_t end = left->first + left->count;
    size_t next = left->first;
    int status = prepare(&r, parameters, left->count, error);
    for (uint32_t slot = 0; (next < end || r.portions[slot ^ 1].count > 0) && status == KILN_OK; slot ^= 1) {
        if (next < end)
            status = begin_portion(&r, slot, next, end - next, error);
        next += r.portions[slot].count;
        if (status == KILN_OK && r.portions[slot ^ 1].count > 0)
            status = end_portion(&r, slot ^ 1, left, rays, refused, error);
        if (status == KILN_OK && r.portions[slot].count > 0)
            status = follow_portion(&r, slot, error);
    }
    if (status == KILN_OK && r.spheres != NULL)
        status = end_spheres(&r, left, rays, error);
    finish(&r, status);
    return status;
}

static int run(struct vulkan_backend *b, const void *parameters, const struct kiln_batch *batch, uint64_t *rays,
               struct kiln_error *error)
{
    return vulkan_run_to_end(b, run_left, parameters, batch, rays, error);
}

/* Rejects images of the sky with several cells, since here there is only one (worker/light/sky_cells.h); and the
 * ray-tracing pipeline, with which this pass is untested. */
static bool takes(const struct vulkan_backend *b, const void *parameters)
{
    const struct kiln_land_parameters *p = parameters;
    return (p->aims == NULL || p->aims->sky.count <= 1) && b->tracer.acceleration == NULL;
}

static void expect(struct vulkan_backend *b, const void *parameters)
{
    const struct kiln_land_parameters *p = parameters;
    struct both_run r = {
        .b = b, .method = KILN_GPU_BOTH_LANDS, .crosses = p->spheres != NULL, .shares = p->techniques != NULL};
    both_expect(&r);
}

static void give_back(struct vulkan_backend *b)
{
    vulkan_techniques_release(b);
    vulkan_spheres_release(b);
}

const struct vulkan_pass vulkan_pass_land = {.run = run, .takes = takes, .expect = expect, .release = give_back};
