#include "worker/backend/vulkan/link_views.h"

#include <string.h>

#include "worker/base/memory.h"

#include "shaders/link_rays.h"
#include "shaders/link_rays_float.h"
#include "shaders/link_rays_pipeline.h"
#include "shaders/link_rays_pipeline_float.h"

static const struct vulkan_shader rays_shader = {.name = "views of links",
                                                 .compute = VULKAN_CODE(link_rays),
                                                 .pipeline = VULKAN_CODE(link_rays_pipeline),
                                                 .compute_float = VULKAN_CODE(link_rays_float),
                                                 .pipeline_float = VULKAN_CODE(link_rays_pipeline_float)};

/* Tile runs that are found together: as many as fit, but no more are begun once they ask so many rays. */
enum { GROUP = 256, ENOUGH_RAYS = 1 << 22 };
/* Rays of a dispatch at most, and of the first. */
enum { MOST_RAYS = 1 << 20, FIRST_RAYS = 1 << 16, LEAST_RAYS = 64 };

/* A ray that is to be traced, for the points `of` of a link. */
struct asked_ray {
    struct kiln_gpu_link_ray ray;
    uint32_t link;
    uint64_t of;
};

/* A tile run whose links are being found. */
struct finding {
    struct kiln_link_run run;
    size_t tile_run;
    bool begun;  /* its rays are asked */
    bool active; /* its links are to be found, for run.error */
    bool found;  /* they are new */
    struct asked_ray *rays;
    size_t count, room;
    size_t first; /* of its rays among the group's */
};

/* A call's working set. */
struct finder {
    struct vulkan_backend *b;
    const struct kiln_links_parameters *p;
    const struct kiln_batch *batch;
    const struct kiln_point_result *gathered;
    struct kiln_kept_links **made;
    size_t *wanted; /* tile runs that have something to be done, `count` of them */
    size_t count;
    struct finding *group;
    size_t group_count;
    float *through; /* of the group's rays */
    size_t through_room, ray_count;
    uint64_t traced;
    int status; /* of the thread that has failed */
    struct kiln_error *error;
};

/* Of the batch's points, the first of a tile run. */
static uint64_t place_of(const struct finder *f, size_t tile_run)
{
    const struct kiln_tile_run *runs = f->b->surface->tile_runs;
    return runs[tile_run].first.at - runs[f->batch->first].first.at;
}

static void note(struct finder *f, int status, const struct kiln_error *error)
{
#pragma omp critical(vulkan_links_status)
    if (status != KILN_OK && f->status == KILN_OK)
        f->status = kiln_fail(f->error, status, "%s", error->message);
}

/* ---- what the host does ---- */

/* kiln_link_ask */
static int ask(void *context, uint32_t link, uint64_t of, struct kiln_vec3 from, struct kiln_vec3 to,
               struct kiln_error *error)
{
    struct finding *g = context;
    if (!(vec3_length(vec3_sub(to, from)) > 0.0f))
        return KILN_OK;
    const int status = kiln_grow(&g->rays, &g->room, g->count + 1, sizeof *g->rays, "the rays of links", error);
    if (status == KILN_OK)
        g->rays[g->count++] = (struct asked_ray){{from, to}, link, of};
    return status;
}

/* The points of a tile run whose links are not kept. Kernels know shading normals: there is room for them. */
static void enter_points(const struct finder *f, struct finding *g)
{
    const struct kiln_surface *s = f->b->surface;
    const struct kiln_tile_run *run = &s->tile_runs[g->tile_run];
    const struct kiln_point_result *gathered = f->gathered + place_of(f, g->tile_run);
    const uint64_t own = kiln_own_of_global(s, run->first).at;
    struct kiln_found_links *found = &g->run.found;
    memset(found->point, 0, sizeof found->point);
    memset(found->shading, 0, sizeof found->shading);
    found->smooth = f->b->constants[VULKAN_HAS_SMOOTH] != 0;
    for (uint32_t k = 0; k < run->count; k++)
        if (kiln_point_valid(s, (struct kiln_own_point){own + k}))
            kiln_link_run_meet(&g->run, g->run.bit[k], &gathered[k]);
    kiln_link_run_enter_found(&g->run);
}

static bool is_above_target(struct finding *g)
{
    const double least = g->run.p->error / KILN_LINKS_LEAST_OPENED;
    return g->run.p->target > 0.0 && 0.5 * g->run.error >= least && kiln_link_run_is_above_target(&g->run);
}

/* Begins a tile run: from what its rays have met, or with the links that are kept. */
static int enter(const struct finder *f, struct finding *g, struct kiln_error *error)
{
    const struct kiln_kept_links *kept = f->p->kept != NULL ? f->p->kept[g->tile_run] : NULL;
    kiln_link_run_enter(&g->run, f->b->surface, &f->b->surface->tile_runs[g->tile_run]);
    g->run.error = f->p->error;
    g->found = false;
    g->active = true;
    if (kept == NULL) {
        enter_points(f, g);
        return KILN_OK;
    }
    const int status = kiln_link_run_take(&g->run, kept, error);
    if (status == KILN_OK)
        g->active = is_above_target(g);
    if (g->active)
        g->run.error *= 0.5;
    return status;
}

/* Goes down the tree, and asks. */
static int find(struct finding *g, struct kiln_error *error)
{
    g->count = 0;
    return g->active ? kiln_link_run_find(&g->run, error) : KILN_OK;
}

/* Takes the answers. */
static int hear(const struct finder *f, struct finding *g, struct kiln_error *error)
{
    const bool parts = f->b->params.geometry->passage >= KILN_PASSAGE_BLEND;
    const float *through = f->through + g->first * (parts ? 3 : 1);
    int status = KILN_OK;
    for (size_t i = 0; i < g->count && status == KILN_OK; i++) {
        const float *one = through + i * (parts ? 3 : 1);
        const double share[3] = {(double)one[0], (double)one[parts ? 1 : 0], (double)one[parts ? 2 : 0]};
        if (share[0] > 0.0 || share[1] > 0.0 || share[2] > 0.0)
            status = kiln_link_run_see(&g->run, g->rays[i].link, g->rays[i].of, share, error);
    }
    if (status != KILN_OK)
        return status;
    kiln_link_run_drop_unseen(&g->run);
    g->found = true;
    g->active = is_above_target(g);
    if (g->active)
        g->run.error *= 0.5;
    return status;
}

/* What has been found, as it is kept. */
static int encode(const struct finder *f, struct finding *g, struct kiln_error *error)
{
    const struct kiln_tile_run *run = &f->b->surface->tile_runs[g->tile_run];
    return g->found ? kiln_links_encode(&f->made[g->tile_run - f->batch->first], &g->run.found, run->first.at,
                                        run->mask, g->run.shares, error)
                    : KILN_OK;
}

/* ---- what the device does ---- */

/* Rays [first, first + count) of the group. */
static void fill(const struct finder *f, size_t first, size_t count, struct kiln_gpu_link_ray *to)
{
#pragma omp parallel for num_threads((int)f->b->threads) schedule(dynamic, 4)
    for (size_t i = 0; i < f->group_count; i++) {
        const struct finding *g = &f->group[i];
        const size_t begin = g->first > first ? g->first : first,
                     end = g->first + g->count < first + count ? g->first + g->count : first + count;
        for (size_t k = begin; k < end; k++)
            to[k - first] = g->rays[k - g->first].ray;
    }
}

static int trace_some(struct finder *f, const struct gpu_buffer *in, const struct gpu_buffer *out, size_t first,
                      size_t count, struct kiln_error *error)
{
    struct vulkan_backend *b = f->b;
    const size_t floats = b->params.geometry->passage >= KILN_PASSAGE_BLEND ? 3 : 1;
    struct gpu_kernel *kernel;
    double seconds;
    int status = vulkan_kernel_of(b, &rays_shader, false, 0, &kernel, error);
    if (status != KILN_OK)
        return status;
    fill(f, first, count, in->mapped);
    const struct kiln_gpu_link_rays_push push = {
        .scene = b->scene.address, .rays = in->address, .through = out->address, .count = (uint32_t)count};
    const struct gpu_step step = {.kernel = kernel,
                                  .threads_x = (uint32_t)count,
                                  .threads_y = 1,
                                  .constants = &push,
                                  .constant_bytes = sizeof push};
    status = gpu_run(b->gpu, &step, 1, &seconds, error);
    if (status != KILN_OK)
        return status;
    gpu_pacer_learn(&b->pacers[VULKAN_PACE_LINK_RAYS], count, seconds);
    memcpy(f->through + first * floats, out->mapped, count * floats * sizeof *f->through);
    return KILN_OK;
}

static int trace_all(struct finder *f, struct kiln_error *error)
{
    struct vulkan_backend *b = f->b;
    const size_t room = f->ray_count < MOST_RAYS ? f->ray_count : MOST_RAYS;
    struct gpu_buffer in = {0}, out = {0};
    int status = gpu_buffer_create(b->gpu, &in, room * sizeof(struct kiln_gpu_link_ray), GPU_HOST, "rays", error);
    if (status == KILN_OK)
        status = gpu_buffer_create(b->gpu, &out, room * 3 * sizeof(float), GPU_HOST, "what rays meet", error);
    for (size_t done = 0, some; done < f->ray_count && status == KILN_OK; done += some) {
        some = gpu_pacer_next(&b->pacers[VULKAN_PACE_LINK_RAYS], FIRST_RAYS);
        some = some > room ? room : some < LEAST_RAYS ? LEAST_RAYS : some;
        some = some > f->ray_count - done ? f->ray_count - done : some;
        status = trace_some(f, &in, &out, done, some, error);
    }
    gpu_buffer_destroy(b->gpu, &in);
    gpu_buffer_destroy(b->gpu, &out);
    return status;
}

/* Traces the group's rays; all of them again after a recovery. */
static int trace(struct finder *f, struct kiln_error *error)
{
    f->ray_count = 0;
    for (size_t i = 0; i < f->group_count; i++) {
        f->group[i].first = f->ray_count;
        f->ray_count += f->group[i].count;
    }
    if (f->ray_count == 0)
        return KILN_OK;
    int status =
        kiln_grow(&f->through, &f->through_room, 3 * f->ray_count, sizeof *f->through, "what rays meet", error);
    if (status == KILN_OK)
        status = trace_all(f, error);
    while (status != KILN_OK && vulkan_can_recover(f->b) && (status = vulkan_recover(f->b, error)) == KILN_OK)
        status = trace_all(f, error);
    f->traced += f->ray_count;
    return status;
}

/* ---- groups ---- */

/* Begins tile runs from the `next`-th on, as many as fit. Which these are hangs on threads, what is found does not. */
static int begin_group(struct finder *f, size_t next)
{
    size_t rays = 0, begun = 0;
    f->group_count = f->count - next < GROUP ? f->count - next : GROUP;
#pragma omp parallel for num_threads((int)f->b->all_threads) schedule(dynamic, 1)
    for (size_t i = 0; i < f->group_count; i++) {
        struct finding *g = &f->group[i];
        size_t before;
        struct kiln_error error;
#pragma omp atomic read
        before = rays;
        g->begun = i == 0 || before < ENOUGH_RAYS;
        g->active = false;
        g->count = 0;
        if (!g->begun)
            continue;
        g->tile_run = f->wanted[next + i];
        g->run.p = f->p;
        g->run.ask = ask;
        g->run.context = g;
        int status = enter(f, g, &error);
        if (status == KILN_OK)
            status = find(g, &error);
        note(f, status, &error);
#pragma omp atomic
        rays += g->count;
    }
    while (begun < f->group_count && f->group[begun].begun)
        begun++;
    /* what was begun behind one that was not is begun again with that */
    f->group_count = begun;
    return f->status;
}

/* Calls a part of the host's work for the group's tile runs. */
static int each(struct finder *f, int (*part)(const struct finder *, struct finding *, struct kiln_error *),
                bool of_active)
{
#pragma omp parallel for num_threads((int)f->b->all_threads) schedule(dynamic, 1)
    for (size_t i = 0; i < f->group_count; i++) {
        struct kiln_error error;
        if (f->group[i].active || !of_active)
            note(f, part(f, &f->group[i], &error), &error);
    }
    return f->status;
}

static int find_again(const struct finder *f, struct finding *g, struct kiln_error *error)
{
    (void)f;
    return find(g, error);
}

static bool is_active(const struct finder *f)
{
    for (size_t i = 0; i < f->group_count; i++)
        if (f->group[i].active)
            return true;
    return false;
}

static int find_group(struct finder *f, size_t next, struct kiln_error *error)
{
    int status = begin_group(f, next);
    while (status == KILN_OK && is_active(f)) {
        status = trace(f, error);
        if (status == KILN_OK)
            status = each(f, hear, true);
        if (status == KILN_OK)
            status = each(f, find_again, false);
    }
    return status == KILN_OK ? each(f, encode, false) : status;
}

/* ---- the call ---- */

static bool is_wanted(const struct finder *f, size_t tile_run)
{
    const struct kiln_kept_links *kept = f->p->kept != NULL ? f->p->kept[tile_run] : NULL;
    return !kiln_batch_leaves_out(f->batch, tile_run) && (kept == NULL || (f->p->target > 0.0 && kept->is_judged == 0));
}

static void finder_release(struct finder *f)
{
    for (size_t i = 0; f->group != NULL && i < GROUP; i++) {
        kiln_link_run_release(&f->group[i].run);
        kiln_free(&f->group[i].rays);
    }
    kiln_free(&f->group);
    kiln_free(&f->wanted);
    kiln_free(&f->through);
}

int vulkan_find_links(struct vulkan_backend *b, const struct kiln_links_parameters *parameters,
                      const struct kiln_batch *batch, const struct kiln_point_result *gathered,
                      struct kiln_kept_links **made, uint64_t *rays, struct kiln_error *error)
{
    static const char what[] = "the links that are missing";
    struct finder f = {.b = b, .p = parameters, .batch = batch, .gathered = gathered, .made = made, .error = error};
    int status = kiln_allocate(&f.wanted, batch->count, sizeof *f.wanted, what, error);
    if (status == KILN_OK)
        status = kiln_allocate(&f.group, GROUP, sizeof *f.group, what, error);
    for (size_t i = 0; i < batch->count && status == KILN_OK; i++)
        if (is_wanted(&f, batch->first + i))
            f.wanted[f.count++] = batch->first + i;
    for (size_t next = 0; next < f.count && status == KILN_OK; next += f.group_count)
        status = find_group(&f, next, error);
    *rays += f.traced;
    finder_release(&f);
    return status;
}
