#include "worker/backend/vulkan/link_views.h"

#include <string.h>

#include "worker/base/arena.h"
#include "worker/base/memory.h"

static const struct vulkan_shader rays_shader = {.name = "views of links",
                                                 .compute = VULKAN_CODE(link_rays),
                                                 .pipeline = VULKAN_CODE(link_rays_pipeline),
                                                 .compute_float = VULKAN_CODE(link_rays_float),
                                                 .pipeline_float = VULKAN_CODE(link_rays_pipeline_float)};

/* GROUP: tile runs of a group. ENOUGH_RAYS: no more tile runs are started for a group with so many rays. */
enum { GROUP = 256, ENOUGH_RAYS = 1 << 22 };
/* Rays of a dispatch: of the first one, at least, and at most. */
enum { FIRST_RAYS = 1 << 16, LEAST_RAYS = 64, MOST_RAYS = 1 << 20 };

/* State of a tile run. FINDS: its links are being found. ASKS: it waits for its rays. STANDS: its links are complete.
 */
enum state { NONE, FINDS, ASKS, STANDS };

/* A tile run whose links are being found. */
struct finding {
    struct kiln_link_run run;
    enum state state;
    size_t tile_run;
    bool found; /* its links are new */
    /* rays, and for each the link and the mask of points that it is for */
    struct kiln_gpu_link_ray *rays;
    uint32_t *links;
    uint64_t *of;
    size_t count, room, room_links, room_of;
    size_t first; /* of its rays among the group's */
};

/* Tile runs whose rays are traced together. While the device traces the rays of one group, the host works on another.
 */
struct group {
    struct finding *of;
    size_t ray_count;
    uint32_t slot; /* of the device, and of the backend's buffers */
    bool under_way;
    uint64_t steps;
};

/* A call's working set. */
struct finder {
    struct vulkan_backend *b;
    const struct kiln_links_parameters *p;
    const struct kiln_batch *batch;
    const struct kiln_point_result *gathered;
    struct kiln_kept_links **made;
    uint64_t key;   /* vulkan_links_key */
    size_t *wanted; /* tile runs with work, `count` of them; `next`: index of the next one to start */
    size_t count, next;
    struct group groups[VULKAN_LINK_GROUPS];
    struct gpu_step *steps; /* of a submission */
    struct kiln_gpu_link_rays_push *pushes;
    size_t step_room, push_room;
    uint64_t traced;
    int status; /* of the thread that has failed */
    struct kiln_error *error;
    struct kiln_arena arena;
};

/* Returns the index of a tile run's first point among the batch's points. */
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

/* Floats of a ray's answer. */
static size_t floats_of(const struct finder *f) { return f->b->params.geometry->passage >= KILN_PASSAGE_BLEND ? 3 : 1; }

/* ---- what the host does ---- */

static int grow(struct finding *g, struct kiln_error *error)
{
    static const char what[] = "the rays of links";
    int status;
    KILN_TRY(kiln_grow(&g->rays, &g->room, g->count + 1, sizeof *g->rays, what, error));
    KILN_TRY(kiln_grow(&g->links, &g->room_links, g->room, sizeof *g->links, what, error));
    KILN_TRY(kiln_grow(&g->of, &g->room_of, g->room, sizeof *g->of, what, error));
end:
    return status;
}

/* kiln_link_ask */
static int ask(void *context, uint32_t link, uint64_t of, const struct kiln_link_sight *sight, struct kiln_error *error)
{
    struct finding *g = context;
    if (!(vec3_length(vec3_sub(sight->to, sight->from)) > 0.0f))
        return KILN_OK;
    const int status = g->count == g->room ? grow(g, error) : KILN_OK;
    if (status != KILN_OK)
        return status;
    g->rays[g->count] = (struct kiln_gpu_link_ray){
        (uint32_t)g->run.index[sight->bit] | (sight->back ? KILN_GPU_LINK_BACK : 0), sight->other};
    g->links[g->count] = link;
    g->of[g->count++] = of;
    return KILN_OK;
}

/* Stores the ray statistics of a tile run's points. */
static void meet_points(const struct finder *f, struct finding *g)
{
    const struct kiln_surface *s = f->b->surface;
    const struct kiln_tile_run *run = &s->tile_runs[g->tile_run];
    const struct kiln_point_result *gathered = f->gathered + place_of(f, g->tile_run);
    const uint64_t own = kiln_own_of_global(s, run->first).at;
    memset(g->run.found.point, 0, sizeof g->run.found.point);
    for (uint32_t k = 0; k < run->count; k++)
        if (kiln_point_valid(s, (struct kiln_own_point){own + k}))
            kiln_link_run_meet(&g->run, g->run.bit[k], &gathered[k]);
    kiln_link_run_enter_found(&g->run);
}

/* Does the same where links are not stored. Kernels compute shading normals, for which there is room. */
static void enter_points(const struct finder *f, struct finding *g)
{
    struct kiln_found_links *found = &g->run.found;
    memset(found->shading, 0, sizeof found->shading);
    found->smooth = f->b->constants[VULKAN_HAS_SMOOTH] != 0;
    meet_points(f, g);
}

/* Starts a tile run: from the statistics of its rays, or with its stored links. */
static int enter(const struct finder *f, struct finding *g, size_t tile_run, struct kiln_error *error)
{
    const struct kiln_kept_links *kept = f->p->kept != NULL ? f->p->kept[tile_run] : NULL;
    g->tile_run = tile_run;
    g->run.p = f->p;
    g->run.ask = ask;
    g->run.context = g;
    kiln_link_run_enter(&g->run, f->b->surface, &f->b->surface->tile_runs[tile_run]);
    g->found = false;
    g->state = FINDS;
    if (kept == NULL) {
        enter_points(f, g);
        return KILN_OK;
    }
    const int status = kiln_link_run_take(&g->run, kept, error);
    if (status != KILN_OK)
        return status;
    meet_points(f, g);
    g->found = true;
    g->state = kiln_link_run_opens(&g->run) ? FINDS : STANDS;
    return KILN_OK;
}

/* Goes down the tree, and asks. */
static int find(struct finding *g, struct kiln_error *error)
{
    g->count = 0;
    g->state = ASKS;
    return kiln_link_run_find(&g->run, error);
}

/* Takes the answers. */
static int hear(const struct finder *f, const struct group *group, struct finding *g, struct kiln_error *error)
{
    const size_t floats = floats_of(f);
    const float *answers = f->b->link_answers[group->slot].mapped, *through = answers + g->first * floats;
    int status = KILN_OK;
    for (size_t i = 0; i < g->count && status == KILN_OK; i++) {
        const float *one = through + i * floats;
        const double share[3] = {(double)one[0], (double)one[floats / 2], (double)one[floats - 1]};
        if (share[0] > 0.0 || share[1] > 0.0 || share[2] > 0.0)
            status = kiln_link_run_see(&g->run, g->links[i], g->of[i], share, error);
    }
    if (status != KILN_OK)
        return status;
    kiln_link_run_drop_unseen(&g->run);
    g->found = true;
    g->count = 0;
    g->state = kiln_link_run_opens(&g->run) ? FINDS : STANDS;
    return KILN_OK;
}

/* Encodes the links found, in the form in which they are stored. */
static int encode(const struct finder *f, struct finding *g, struct kiln_error *error)
{
    const struct kiln_tile_run *run = &f->b->surface->tile_runs[g->tile_run];
    g->state = NONE;
    return g->found ? kiln_links_encode(&f->made[g->tile_run - f->batch->first], &g->run.found, run->first.at,
                                        run->mask, g->run.shares, error)
                    : KILN_OK;
}

/* Takes the next tile run for a group whose tile runs have `rays` rays so far; false: it has enough, or there is none.
 */
static bool take_next(struct finder *f, const size_t *rays, size_t *tile_run)
{
    bool any;
#pragma omp critical(vulkan_links_next)
    {
        size_t asked;
#pragma omp atomic read
        asked = *rays;
        any = f->next < f->count && asked < ENOUGH_RAYS;
        if (any)
            *tile_run = f->wanted[f->next++];
    }
    return any;
}

/* Processes the results of a tile run's rays, and continues until it needs rays again; when its links are complete,
 * continues with the next tile run. Which one depends on thread timing; the links found do not. */
static int advance(struct finder *f, const struct group *group, struct finding *g, size_t *rays,
                   struct kiln_error *error)
{
    size_t tile_run;
    int status = g->state == ASKS ? hear(f, group, g, error) : KILN_OK;
    while (status == KILN_OK) {
        if (g->state == STANDS)
            status = encode(f, g, error);
        if (status == KILN_OK && g->state == NONE) {
            if (!take_next(f, rays, &tile_run))
                return KILN_OK;
            status = enter(f, g, tile_run, error);
        }
        if (status != KILN_OK || g->state != FINDS)
            continue;
        status = find(g, error);
        if (status == KILN_OK && g->count > 0)
            break;
        if (status == KILN_OK)
            status = hear(f, group, g, error); /* nothing */
    }
#pragma omp atomic
    *rays += g->count;
    return status;
}

/* Does the host's work for a group whose results have arrived. */
static int advance_all(struct finder *f, struct group *group)
{
    size_t rays = 0;
#pragma omp parallel for num_threads((int)f->b->all_threads) schedule(dynamic, 1)
    for (size_t i = 0; i < GROUP; i++) {
        struct kiln_error error;
        note(f, advance(f, group, &group->of[i], &rays, &error), &error);
    }
    group->ray_count = 0;
    for (size_t i = 0; i < GROUP; i++) {
        group->of[i].first = group->ray_count;
        group->ray_count += group->of[i].count;
    }
    f->traced += group->ray_count;
    return f->status;
}

/* ---- what the device does ---- */

/* Uploads the positions of all points, and of points in the tree's order. */
static int bring_places(const struct finder *f, struct kiln_error *error)
{
    const size_t all = (size_t)f->b->surface->point_count, count = f->p->node_count > 0 ? (size_t)f->p->count : 0;
    struct kiln_gpu_link_place *places = NULL;
    if (vulkan_links_there(f->b, VULKAN_LINK_PLACES, f->key))
        return KILN_OK;
    int status = kiln_allocate(&places, all + count, sizeof *places, "the places of points", error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for num_threads((int)f->b->threads) if (all > 1 << 14)
    for (size_t i = 0; i < all + count; i++)
        places[i].at = i < all ? f->p->points[i].place : f->p->leaves[i - all].place;
    status = vulkan_links_bring(f->b, VULKAN_LINK_PLACES, f->key, places, (all + count) * sizeof *places, error);
    kiln_free(&places);
    return status;
}

/* Enlarges a group's buffer; its contents are lost. */
static int make_room(struct vulkan_backend *b, struct gpu_buffer *buffer, size_t bytes, const char *what,
                     struct kiln_error *error)
{
    if (!gpu_guarded(b->gpu))
        bytes = bytes <= buffer->size ? buffer->size : bytes + bytes / 4;
    return vulkan_grow_buffer(b, buffer, bytes, GPU_HOST, what, error);
}

static void copy_rays(const struct finder *f, const struct group *group)
{
    struct kiln_gpu_link_ray *to = f->b->link_rays[group->slot].mapped;
#pragma omp parallel for num_threads((int)f->b->threads) schedule(dynamic, 4) if (group->ray_count > 1 << 14)
    for (size_t i = 0; i < GROUP; i++) {
        const struct finding *g = &group->of[i];
        if (g->count > 0)
            memcpy(to + g->first, g->rays, g->count * sizeof *g->rays);
    }
}

/* Divides the group's rays into dispatches within the time limit. */
static int make_steps(struct finder *f, struct group *group, struct gpu_kernel *kernel, struct kiln_error *error)
{
    const struct vulkan_backend *b = f->b;
    const size_t floats = floats_of(f);
    size_t some = gpu_pacer_next(&b->pacers[VULKAN_PACE_LINK_RAYS], FIRST_RAYS);
    some = some > MOST_RAYS ? MOST_RAYS : some < LEAST_RAYS ? LEAST_RAYS : some;
    group->steps = (group->ray_count + some - 1) / some;
    int status;
    KILN_TRY(kiln_arena_grow(&f->arena, &f->steps, &f->step_room, group->steps, sizeof *f->steps, "the rays of links",
                             error));
    KILN_TRY(kiln_arena_grow(&f->arena, &f->pushes, &f->push_room, group->steps, sizeof *f->pushes, "the rays of links",
                             error));
    for (size_t i = 0; i < group->steps; i++) {
        const size_t first = i * some, left = group->ray_count - first, count = left < some ? left : some;
        f->pushes[i] = (struct kiln_gpu_link_rays_push){
            .scene = b->scene.address,
            .rays = b->link_rays[group->slot].address + first * sizeof(struct kiln_gpu_link_ray),
            .through = b->link_answers[group->slot].address + first * floats * sizeof(float),
            .places = b->links[VULKAN_LINK_PLACES].address,
            .others =
                b->links[VULKAN_LINK_PLACES].address + b->surface->point_count * sizeof(struct kiln_gpu_link_place),
            .count = (uint32_t)count};
        f->steps[i] = (struct gpu_step){.alongside = i > 0,
                                        .kernel = kernel,
                                        .threads_x = (uint32_t)count,
                                        .threads_y = 1,
                                        .constants = &f->pushes[i],
                                        .constant_bytes = sizeof f->pushes[i]};
    }
end:
    return status;
}

/* Submits the group's rays to the device, if there are any. */
static int launch(struct finder *f, struct group *group, struct kiln_error *error)
{
    struct vulkan_backend *b = f->b;
    struct gpu_kernel *kernel;
    group->under_way = false;
    if (group->ray_count == 0)
        return KILN_OK;
    int status;
    KILN_TRY(vulkan_kernel_of(b, &rays_shader, false, 0, &kernel, error));
    KILN_TRY(bring_places(f, error));
    KILN_TRY(make_room(b, &b->link_rays[group->slot], group->ray_count * sizeof(struct kiln_gpu_link_ray),
                       "the rays of links", error));
    KILN_TRY(make_room(b, &b->link_answers[group->slot], group->ray_count * floats_of(f) * sizeof(float),
                       "what rays meet", error));
end:
    if (status != KILN_OK)
        return status;
    copy_rays(f, group);
    status = make_steps(f, group, kernel, error);
    if (status == KILN_OK)
        status = gpu_submit(b->gpu, group->slot, f->steps, group->steps, error);
    group->under_way = status == KILN_OK;
    return status;
}

static int wait(const struct finder *f, struct group *group, struct kiln_error *error)
{
    double seconds = 0.0;
    if (!group->under_way)
        return KILN_OK;
    const int status = gpu_wait(f->b->gpu, group->slot, &seconds, error);
    group->under_way = false;
    if (status == KILN_OK)
        gpu_pacer_learn(&f->b->pacers[VULKAN_PACE_LINK_RAYS], group->ray_count / group->steps,
                        seconds / (double)group->steps);
    return status;
}

/* After a failure: a new device traces the rays of all groups without results. */
static int launch_again(struct finder *f, int status, struct kiln_error *error)
{
    while (status != KILN_OK && vulkan_can_recover(f->b)) {
        status = vulkan_recover(f->b, error);
        for (size_t i = 0; i < VULKAN_LINK_GROUPS; i++)
            f->groups[i].under_way = false; /* the device is gone */
        if (status != KILN_OK)
            return status;
        for (size_t i = 0; i < VULKAN_LINK_GROUPS && status == KILN_OK; i++)
            status = launch(f, &f->groups[i], error);
    }
    return status;
}

/* ---- groups ---- */

/* Waits for a group's results, processes them, and submits its next rays. */
static int turn(struct finder *f, struct group *group, struct kiln_error *error)
{
    int status = wait(f, group, error);
    while (status != KILN_OK) {
        status = launch_again(f, status, error);
        if (status != KILN_OK)
            return status;
        status = wait(f, group, error);
    }
    status = advance_all(f, group);
    return status == KILN_OK ? launch_again(f, launch(f, group, error), error) : status;
}

/* Processes the groups in turn, until no rays are left. */
static int find_all(struct finder *f, struct kiln_error *error)
{
    int status = KILN_OK;
    bool any = true;
    while (any && status == KILN_OK) {
        any = false;
        for (size_t i = 0; i < VULKAN_LINK_GROUPS && status == KILN_OK; i++) {
            status = turn(f, &f->groups[i], error);
            any = any || f->groups[i].ray_count > 0;
        }
    }
    for (size_t i = 0; i < VULKAN_LINK_GROUPS; i++) { /* after a failure, nothing may still be running */
        struct kiln_error ignored;
        (void)wait(f, &f->groups[i], &ignored);
    }
    return status;
}

/* ---- the call ---- */

static bool is_wanted(const struct finder *f, size_t tile_run)
{
    const struct kiln_kept_links *kept = f->p->kept != NULL ? f->p->kept[tile_run] : NULL;
    return !kiln_batch_leaves_out(f->batch, tile_run) && (kept == NULL || kiln_link_run_is_to_judge(f->p, kept));
}

static int make_groups(struct finder *f, struct kiln_error *error)
{
    int status = KILN_OK;
    for (uint32_t i = 0; i < VULKAN_LINK_GROUPS && status == KILN_OK; i++) {
        f->groups[i].slot = i;
        status = kiln_allocate(&f->groups[i].of, GROUP, sizeof *f->groups[i].of, "the links that are missing", error);
    }
    return status;
}

static void finder_release(struct finder *f)
{
    for (size_t k = 0; k < VULKAN_LINK_GROUPS; k++) {
        for (size_t i = 0; f->groups[k].of != NULL && i < GROUP; i++) {
            struct finding *g = &f->groups[k].of[i];
            kiln_link_run_release(&g->run);
            kiln_free(&g->rays);
            kiln_free(&g->links);
            kiln_free(&g->of);
        }
        kiln_free(&f->groups[k].of);
    }
    kiln_arena_release(&f->arena);
}

int vulkan_find_links(struct vulkan_backend *b, const struct kiln_links_parameters *parameters,
                      const struct kiln_batch *batch, const struct kiln_point_result *gathered, uint64_t key,
                      struct kiln_kept_links **made, uint64_t *rays, struct kiln_error *error)
{
    struct finder f = {
        .b = b, .p = parameters, .batch = batch, .gathered = gathered, .made = made, .key = key, .error = error};
    int status;
    KILN_TRY(
        kiln_arena_allocate(&f.arena, &f.wanted, batch->count, sizeof *f.wanted, "the links that are missing", error));
    for (size_t i = 0; i < batch->count; i++)
        if (is_wanted(&f, batch->first + i))
            f.wanted[f.count++] = batch->first + i;
    if (f.count > 0)
        KILN_TRY(make_groups(&f, error));
    if (f.count > 0)
        KILN_TRY(find_all(&f, error));
end:
    *rays += f.traced;
    finder_release(&f);
    return status;
}
