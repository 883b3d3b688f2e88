#include "worker/backend/vulkan/visibility.h"

#include <string.h>

#include "worker/base/memory.h"

static const struct vulkan_shader forget_shader = {.name = "kept pairs: forgetting",
                                                   .compute = VULKAN_CODE(sight_forget)},
                                  open_shader = {.name = "kept pairs: laid out", .compute = VULKAN_CODE(sight_open)},
                                  close_shader = {.name = "kept pairs: what is known",
                                                  .compute = VULKAN_CODE(sight_close)},
                                  store_shader = {.name = "kept pairs: bits", .compute = VULKAN_CODE(sight_store)};

#define VISIBILITY_BUFFER (1ull << 30)

static const char kept_pairs[] = "what patches see of each other";

/* Bytes of a tile run's table, without its bits. */
static uint64_t table_bytes(uint64_t groups) { return groups * sizeof(uint32_t) * KILN_VISIBILITY_DEVICE_WORDS; }

/* Whether visibility is kept in this pass: only for own tile runs. */
static bool keeps(const struct vulkan_backend *b, const struct kiln_patches_parameters *p)
{
    return p->cache != NULL && b->surface == b->own;
}

uint32_t vulkan_visibility_sight(const struct vulkan_backend *b, const struct kiln_patches_parameters *p)
{
    return (p->voxels != NULL ? KILN_GPU_SIGHT_VOXELS : 0) | (keeps(b, p) ? KILN_GPU_SIGHT_KEPT : 0);
}

size_t vulkan_visibility_scratch(const struct vulkan_backend *b, const struct kiln_patches_parameters *p)
{
    return keeps(b, p) ? (size_t)kiln_visibility_cache_of_step(p->cache).groups * sizeof(uint64_t) : 0;
}

/* ---- the grid ---- */

/* Uploads the grid's numbers as the kernels' `real`. */
static int bring_reals(struct vulkan_backend *b, const struct kiln_voxel_arrays *a, struct kiln_error *error)
{
    const double reals[KILN_GPU_GRID_REALS] = {a->low.x, a->low.y, a->low.z, a->scale};
    float floats[KILN_GPU_GRID_REALS];
    for (size_t i = 0; i < KILN_GPU_GRID_REALS; i++)
        floats[i] = (float)reals[i];
    return gpu_buffer_of(b->gpu, &b->visibility.reals, b->float64 ? (const void *)reals : floats,
                         b->float64 ? sizeof reals : sizeof floats, "the voxels", error);
}

static void release_grid(struct vulkan_backend *b)
{
    struct vulkan_visibility *v = &b->visibility;
    gpu_buffer_destroy(b->gpu, &v->words);
    gpu_buffer_destroy(b->gpu, &v->reals);
    v->grid.words = NULL;
}

static int bring_grid(struct vulkan_backend *b, const struct kiln_voxels *grid, struct kiln_error *error)
{
    static const char what[] = "the voxels";
    struct vulkan_visibility *v = &b->visibility;
    const struct kiln_voxel_arrays a = kiln_voxels_arrays(grid);
    release_grid(b);
    int status = gpu_buffer_of(b->gpu, &v->words, a.words, a.word_count * sizeof *a.words, what, error);
    if (status == KILN_OK)
        status = bring_reals(b, &a, error);
    v->grid = a;
    if (status != KILN_OK)
        v->grid.words = NULL;
    return status;
}

static bool has_grid(const struct vulkan_backend *b, const struct kiln_voxels *grid)
{
    const struct kiln_voxel_arrays a = kiln_voxels_arrays(grid), *v = &b->visibility.grid;
    return v->words == a.words && v->scale == a.scale && v->word_count == a.word_count && v->filled == a.filled;
}

/* ---- room for what is kept ---- */

static void release_kept(struct vulkan_backend *b)
{
    struct vulkan_visibility *v = &b->visibility;
    for (size_t i = 0; i < v->buffer_count; i++)
        gpu_buffer_destroy(b->gpu, &v->buffers[i]);
    v->buffer_count = 0;
    kiln_free(&v->buffers);
    v->buffer_room = 0;
    gpu_buffer_destroy(b->gpu, &v->runs);
    gpu_buffer_destroy(b->gpu, &v->changes);
    kiln_free(&v->places);
    v->of = NULL;
}

void vulkan_visibility_release(struct vulkan_backend *b)
{
    release_grid(b);
    release_kept(b);
    gpu_buffer_destroy(b->gpu, &b->visibility.root);
}

/* The tile run's share of `most` bytes. */
static uint64_t share_of(const struct vulkan_backend *b, size_t tile_run, uint64_t groups, uint64_t most,
                         struct kiln_gpu_sight_run *run)
{
    const uint32_t count = b->own->tile_runs[tile_run].count;
    const uint64_t share = (uint64_t)((double)most * count / (double)b->own->count), tables = table_bytes(groups),
                   a_pair = count * sizeof(uint64_t);
    *run = (struct kiln_gpu_sight_run){.count = count};
    if (share < tables)
        return 0;
    run->room = (uint32_t)((share - tables) / a_pair < groups ? (share - tables) / a_pair : groups);
    return tables + run->room * a_pair;
}

/* Allocates a buffer for tile runs first .. end-1; without memory on the device they get no room. */
static int make_buffer(struct vulkan_backend *b, struct kiln_gpu_sight_run *runs, size_t first, size_t end,
                       uint64_t bytes, uint64_t groups, uint64_t most, struct kiln_error *error)
{
    struct vulkan_visibility *v = &b->visibility;
    struct kiln_error unused = {""};
    struct kiln_gpu_sight_run run;
    if (bytes == 0)
        return KILN_OK;
    int status = kiln_grow(&v->buffers, &v->buffer_room, v->buffer_count + 1, sizeof *v->buffers, kept_pairs, error);
    if (status != KILN_OK)
        return status;
    struct gpu_buffer *buffer = &v->buffers[v->buffer_count];
    *buffer = (struct gpu_buffer){0};
    status = gpu_buffer_create(b->gpu, buffer, bytes, GPU_DEVICE, kept_pairs, &unused);
    if (status != KILN_OK && gpu_lost(b->gpu)) {
        if (error != NULL)
            *error = unused;
        return status;
    }
    if (status != KILN_OK)
        return KILN_OK;
    v->buffer_count++;
    uint64_t at = buffer->address;
    for (size_t i = first; i < end; i++) {
        const uint64_t share = share_of(b, i, groups, most, &run);
        runs[i].words = share > 0 ? at : 0;
        at += share;
    }
    return KILN_OK;
}

static int make_buffers(struct vulkan_backend *b, struct kiln_gpu_sight_run *runs, uint64_t groups, uint64_t most,
                        struct kiln_error *error)
{
    size_t first = 0;
    uint64_t bytes = 0;
    int status = KILN_OK;
    for (size_t i = 0; i < b->own->tile_run_count && status == KILN_OK; i++) {
        const uint64_t share = share_of(b, i, groups, most, &runs[i]);
        if (bytes + share > VISIBILITY_BUFFER) {
            status = make_buffer(b, runs, first, i, bytes, groups, most, error);
            first = i;
            bytes = 0;
        }
        bytes += share;
    }
    return status == KILN_OK ? make_buffer(b, runs, first, b->own->tile_run_count, bytes, groups, most, error) : status;
}

static int make_room(struct vulkan_backend *b, const struct kiln_visibility_cache *cache,
                     const struct kiln_visibility_of_step *of, struct kiln_error *error)
{
    struct vulkan_visibility *v = &b->visibility;
    struct kiln_gpu_sight_run *runs = NULL;
    const size_t count = b->own->tile_run_count;
    release_kept(b);
    const uint64_t left = gpu_memory_left(b->gpu) / 2;
    int status = kiln_allocate(&runs, count, sizeof *runs, kept_pairs, error);
    if (status == KILN_OK)
        status = kiln_allocate(&v->places, count, sizeof *v->places, kept_pairs, error);
    if (status == KILN_OK)
        status = make_buffers(b, runs, of->groups, of->most < left ? of->most : left, error);
    if (status == KILN_OK)
        status = gpu_buffer_of(b->gpu, &v->runs, runs, count * sizeof *runs, kept_pairs, error);
    if (status == KILN_OK)
        status = gpu_buffer_create(b->gpu, &v->changes, of->groups * 2 * sizeof(uint64_t) + count * sizeof(uint32_t),
                                   GPU_DEVICE, kept_pairs, error);
    v->of = cache;
    v->surface = b->own;
    v->moved = of->moved;
    v->first = b->own->first.at;
    v->count = b->own->count;
    v->groups = of->groups;
    v->step = 0;
    kiln_free(&runs);
    if (status != KILN_OK)
        v->of = NULL;
    return status;
}

static bool has_room(const struct vulkan_backend *b, const struct kiln_visibility_cache *cache,
                     const struct kiln_visibility_of_step *of)
{
    const struct vulkan_visibility *v = &b->visibility;
    return v->of == cache && v->surface == b->own && v->moved == of->moved && v->first == b->own->first.at &&
           v->count == b->own->count && v->groups == of->groups;
}

/* ---- forgetting ---- */

/* Mask of a tile run's points that the batch computes. */
static uint64_t places_of(const struct vulkan_backend *b, const struct kiln_batch *batch, size_t tile_run)
{
    const struct kiln_surface *s = b->own;
    const struct kiln_tile_run *run = &s->tile_runs[tile_run];
    const struct kiln_own_point own = kiln_own_of_global(s, run->first);
    uint64_t places = 0;
    for (uint32_t i = 0; i < run->count; i++)
        if (kiln_point_valid(s, (struct kiln_own_point){own.at + i}))
            places |= (uint64_t)1 << i;
    return places & kiln_batch_points(batch, tile_run);
}

/* Records which points of its tile runs the batch computes; false: the same as last time. */
static bool note_places(struct vulkan_backend *b, const struct kiln_batch *batch, uint32_t *forget)
{
    bool any = false;
    for (size_t i = batch->first; i < batch->first + batch->count; i++) {
        const uint64_t places = places_of(b, batch, i);
        if (b->visibility.places[i] == places)
            continue;
        forget[i] = 1;
        any = true;
        b->visibility.places[i] = places;
    }
    return any;
}

static int upload_changes(struct vulkan_backend *b, const struct kiln_visibility_of_step *of, const uint64_t *same,
                          const uint32_t *forget, struct kiln_error *error)
{
    const struct gpu_buffer *to = &b->visibility.changes;
    const size_t of_groups = of->groups * sizeof(uint64_t);
    int status;
    KILN_TRY(gpu_upload(b->gpu, to, 0, of->columns, of_groups, error));
    KILN_TRY(gpu_upload(b->gpu, to, of_groups, same, of_groups, error));
    KILN_TRY(gpu_upload(b->gpu, to, 2 * of_groups, forget, b->own->tile_run_count * sizeof *forget, error));
end:
    return status;
}

static int run_forget(struct vulkan_backend *b, uint64_t groups, struct kiln_error *error)
{
    const struct vulkan_visibility *v = &b->visibility;
    const struct kiln_gpu_sight_forget_push push = {.sight = v->root.address,
                                                    .same = v->changes.address + groups * sizeof(uint64_t),
                                                    .forget = v->changes.address + 2 * groups * sizeof(uint64_t),
                                                    .runs = (uint32_t)b->own->tile_run_count};
    struct gpu_kernel *kernel;
    const int status = vulkan_kernel_of(b, &forget_shader, false, 0, &kernel, error);
    if (status != KILN_OK)
        return status;
    const struct gpu_step step = {.kernel = kernel,
                                  .threads_x = (uint32_t)groups,
                                  .threads_y = push.runs,
                                  .constants = &push,
                                  .constant_bytes = sizeof push};
    return gpu_run(b->gpu, &step, 1, NULL, error);
}

/* Clears stored visibility that is invalid: after changes of nodes or points, or steps computed without this device. */
static int forget(struct vulkan_backend *b, const struct kiln_visibility_of_step *of, const struct kiln_batch *batch,
                  struct kiln_error *error)
{
    struct vulkan_visibility *v = &b->visibility;
    const size_t runs = b->own->tile_run_count;
    const bool next = of->step == v->step + 1, new_step = of->step != v->step;
    uint32_t *forgotten = NULL;
    uint64_t *same = NULL;
    int status;
    KILN_TRY(kiln_allocate(&forgotten, runs, sizeof *forgotten, kept_pairs, error));
    KILN_TRY(kiln_allocate(&same, (size_t)of->groups, sizeof *same, kept_pairs, error));
    const bool moved = note_places(b, batch, forgotten);
    for (size_t i = 0; i < runs && new_step && !next; i++)
        forgotten[i] = 1;
    for (uint64_t g = 0; g < of->groups; g++)
        same[g] = new_step ? of->same[g] : UINT64_MAX;
    if (new_step || moved)
        KILN_TRY(upload_changes(b, of, same, forgotten, error));
    if (new_step || moved)
        KILN_TRY(run_forget(b, of->groups, error));
    v->step = of->step;
end:
    kiln_free(&forgotten);
    kiln_free(&same);
    return status;
}

/* ---- a pass ---- */

static int make_kernels(struct vulkan_backend *b, struct kiln_error *error)
{
    struct vulkan_visibility *v = &b->visibility;
    int status;
    KILN_TRY(vulkan_kernel_of(b, &open_shader, false, 0, &v->open, error));
    KILN_TRY(vulkan_kernel_of(b, &close_shader, false, 0, &v->close, error));
    KILN_TRY(vulkan_kernel_of(b, &store_shader, false, 0, &v->store, error));
end:
    return status;
}

int vulkan_visibility_prepare(struct vulkan_backend *b, const struct kiln_patches_parameters *p,
                              const struct kiln_batch *batch, struct kiln_error *error)
{
    struct vulkan_visibility *v = &b->visibility;
    const bool kept = keeps(b, p);
    struct kiln_visibility_of_step of = {0};
    int status = KILN_OK;
    if (vulkan_visibility_sight(b, p) == 0)
        return KILN_OK;
    if (p->voxels != NULL && !has_grid(b, p->voxels))
        status = bring_grid(b, p->voxels, error);
    if (kept)
        of = kiln_visibility_cache_of_step(p->cache);
    if (status == KILN_OK && kept && !has_room(b, p->cache, &of))
        status = make_room(b, p->cache, &of, error);
    const struct kiln_gpu_sight root = {.words = v->words.address,
                                        .reals = v->reals.address,
                                        .runs = v->runs.address,
                                        .n = {(uint32_t)v->grid.n[0], (uint32_t)v->grid.n[1], (uint32_t)v->grid.n[2]},
                                        .groups = (uint32_t)of.groups};
    KILN_TRY(status);
    KILN_TRY(vulkan_grow_buffer(b, &v->root, sizeof root, GPU_DEVICE, kept_pairs, error));
    KILN_TRY(gpu_upload(b->gpu, &v->root, 0, &root, sizeof root, error));
    if (kept)
        KILN_TRY(forget(b, &of, batch, error));
end:
    return status == KILN_OK && kept ? make_kernels(b, error) : status;
}

static struct kiln_gpu_sight_push push_of(const struct vulkan_backend *b, const struct vulkan_chunk *chunk,
                                          const struct kiln_gpu_patches_push *pairs)
{
    return (struct kiln_gpu_sight_push){.sight = pairs->sight,
                                        .points = pairs->points,
                                        .open = pairs->open,
                                        .columns = b->visibility.changes.address,
                                        .total = chunk->all.total,
                                        .run_first = (uint32_t)chunk->tile_run_first,
                                        .runs = (uint32_t)chunk->tile_run_count};
}

void vulkan_visibility_open(const struct vulkan_backend *b, const struct vulkan_chunk *chunk,
                            const struct kiln_gpu_patches_push *pairs, struct vulkan_recording *recording)
{
    const struct kiln_gpu_sight_push push = push_of(b, chunk, pairs);
    vulkan_record(recording, b->visibility.open, push.total, 2 * (uint32_t)b->visibility.groups, &push, sizeof push);
}

void vulkan_visibility_close(const struct vulkan_backend *b, const struct vulkan_chunk *chunk,
                             const struct kiln_gpu_patches_push *pairs, struct vulkan_recording *recording)
{
    const struct kiln_gpu_sight_push push = push_of(b, chunk, pairs);
    vulkan_record(recording, b->visibility.close, push.runs, 1, &push, sizeof push);
    vulkan_record(recording, b->visibility.store, push.total, 2 * (uint32_t)b->visibility.groups, &push, sizeof push);
}

int vulkan_visibility_count(struct vulkan_backend *b, struct kiln_visibility_counts *counts, struct kiln_error *error)
{
    const struct vulkan_visibility *v = &b->visibility;
    const size_t count = b->own->tile_run_count;
    struct kiln_gpu_sight_run *runs = NULL;
    int status;
    KILN_TRY(kiln_allocate(&runs, count, sizeof *runs, kept_pairs, error));
    KILN_TRY(gpu_download(b->gpu, &v->runs, 0, runs, count * sizeof *runs, error));
    for (size_t i = 0; i < count; i++) {
        counts->open += runs[i].open;
        counts->shut += runs[i].shut;
        counts->mixed += runs[i].mixed;
        counts->unknown += runs[i].unknown;
    }
end:
    for (size_t i = 0; i < v->buffer_count; i++)
        counts->bytes += v->buffers[i].size;
    kiln_free(&runs);
    return status;
}
