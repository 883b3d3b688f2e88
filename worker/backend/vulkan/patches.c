/* The patches pass (worker/pass/patches.h). The gather pass's rays measure the losses; shaders/patches.comp processes
 * pairs, and patches_reduce.comp sums up. Nodes lie in rows of a fixed length, so that the order of sums depends on
 * nothing else. */
#include "worker/pass/patches.h"

#include <string.h>

#include "worker/backend/vulkan/hemisphere.h"
#include "worker/backend/vulkan/visibility.h"
#include "worker/base/memory.h"

static const struct vulkan_shader pairs_shader = {.name = "pairs of patches",
                                                  .compute = VULKAN_CODE(patches),
                                                  .pipeline = VULKAN_CODE(patches_pipeline),
                                                  .compute_float = VULKAN_CODE(patches_float),
                                                  .pipeline_float = VULKAN_CODE(patches_pipeline_float)};
static const struct vulkan_shader sums_shader = {.name = "pairs of patches: sums",
                                                 .compute = VULKAN_CODE(patches_reduce)};

/* Nodes of a row, the loop of a thread. A dispatch takes at least as long as its longest loop. With long rows this
 * would fill a time slice, and dispatches would never grow to enough threads to fill a device (gpu_pacer_next follows
 * their speed). A software device ends a thread's loops after 65,535 iterations in all. */
enum { ROW = 64 };

/* A call's working set. */
struct patches_run {
    struct vulkan_backend *b;
    const struct kiln_patches_parameters *p;
    const struct kiln_batch *batch;
    struct kiln_point_result *gathered; /* ray statistics of the batch's points */
    struct kiln_patches_result *results;
    struct gpu_kernel *pairs, *sums;
    uint32_t row, rows; /* nodes of a row; rows */
    uint64_t rays;
    struct kiln_visibility_counts seen;
};

/* Returns the index of a tile run's first point among the batch's points. */
static uint64_t place_of(const struct patches_run *r, size_t tile_run)
{
    const struct kiln_tile_run *runs = r->b->surface->tile_runs;
    return runs[tile_run].first.at - runs[r->batch->first].first.at;
}

/* ---- what lies on the device ---- */

static void describe_points(const struct patches_run *r, struct kiln_gpu_patch *to, uint64_t count)
{
    const struct kiln_surface *s = r->b->surface;
    const struct kiln_global_point global = s->tile_runs[r->batch->first].first;
    const struct kiln_own_point own = kiln_own_of_global(s, global);
#pragma omp parallel for num_threads((int)r->b->threads) if (count > 1 << 14)
    for (uint64_t i = 0; i < count; i++) {
        const struct kiln_patch *patch = &r->p->points[global.at + i];
        to[i] = (struct kiln_gpu_patch){.place = patch->place, .normal = patch->normal, .number = patch->number};
        for (uint64_t c = 0; c < 3; c++)
            to[i].albedo[c] = (float)s->albedo[3 * (own.at + i) + c] / 65535.0f;
    }
    for (size_t f = r->batch->first; f < r->batch->first + r->batch->count; f++)
        for (uint32_t i = 0; i < s->tile_runs[f].count; i++) {
            struct kiln_gpu_patch *point = &to[place_of(r, f) + i];
            point->run = (uint32_t)f;
            point->place_in_run = i;
        }
}

static void describe_nodes(const struct patches_run *r, struct kiln_gpu_patch_node_facing *facings,
                           struct kiln_gpu_patch_node_shape *shapes)
{
#pragma omp parallel for num_threads((int)r->b->threads) if (r->p->count > 1 << 14)
    for (uint64_t k = 0; k < r->p->count; k++) {
        const struct kiln_patch_node *node = &r->p->nodes[k];
        const struct kiln_patch *patch = &node->patch;
        facings[k] = (struct kiln_gpu_patch_node_facing){node->centre, patch->area, patch->normal, patch->number};
        shapes[k] = (struct kiln_gpu_patch_node_shape){
            .place = patch->place,
            .edge_s = patch->edge_s,
            .edge_t = patch->edge_t,
            .radiosity = {node->radiosity[0], node->radiosity[1], node->radiosity[2]}};
    }
}

/* Uploads data to a buffer of the backend, which is enlarged if needed. */
static int bring(struct vulkan_backend *b, struct gpu_buffer *buffer, const void *data, size_t bytes, const char *what,
                 struct kiln_error *error)
{
    int status = vulkan_grow_buffer(b, buffer, bytes, GPU_DEVICE, what, error);
    if (status == KILN_OK && bytes > 0)
        status = gpu_upload(b->gpu, buffer, 0, data, bytes, error);
    return status;
}

static int bring_points(const struct patches_run *r, struct kiln_error *error)
{
    static const char what[] = "the patches of points";
    const struct kiln_tile_run *runs = r->b->surface->tile_runs + r->batch->first;
    const uint64_t count = kiln_tile_runs_points(runs, runs + r->batch->count - 1);
    struct kiln_gpu_patch *points = NULL;
    int status = kiln_allocate(&points, (size_t)count, sizeof *points, what, error);
    if (status == KILN_OK) {
        describe_points(r, points, count);
        status = bring(r->b, &r->b->patches, points, (size_t)count * sizeof *points, what, error);
    }
    kiln_free(&points);
    return status;
}

static int bring_nodes(const struct patches_run *r, struct kiln_error *error)
{
    static const char what[] = "the nodes that points gather from";
    const size_t count = (size_t)r->p->count;
    struct kiln_gpu_patch_node_facing *facings = NULL;
    struct kiln_gpu_patch_node_shape *shapes = NULL;
    int status;
    KILN_TRY(kiln_allocate(&facings, count, sizeof *facings, what, error));
    KILN_TRY(kiln_allocate(&shapes, count, sizeof *shapes, what, error));
    describe_nodes(r, facings, shapes);
    KILN_TRY(bring(r->b, &r->b->node_facings, facings, count * sizeof *facings, what, error));
    KILN_TRY(bring(r->b, &r->b->node_shapes, shapes, count * sizeof *shapes, what, error));
end:
    kiln_free(&facings);
    kiln_free(&shapes);
    return status;
}

/* ---- rays that measure losses ---- */

/* kiln_take_results */
static int keep(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    (void)error;
    const struct patches_run *r = context;
    const struct kiln_tile_run *runs = &r->b->surface->tile_runs[first];
    memcpy(r->gathered + place_of(r, first), results,
           (size_t)kiln_tile_runs_points(runs, runs + count - 1) * sizeof *r->gathered);
    return KILN_OK;
}

/* Reads back the ray statistics from the step that closed the rows. */
static void recall(const struct patches_run *r, uint64_t points)
{
    const struct kiln_surface *s = r->b->surface;
    const struct kiln_own_point first = kiln_own_of_global(s, s->tile_runs[r->batch->first].first);
    for (uint64_t i = 0; i < points; i++)
        if (kiln_point_valid(s, (struct kiln_own_point){first.at + i}))
            r->gathered[i] = kiln_closing_rays(&s->closing[KILN_CLOSING_FLOATS * (first.at + i)], r->batch->samples);
}

static int gather(struct patches_run *r, struct kiln_error *error)
{
    const uint64_t own[2] = {0, 0}; /* filled in for each chunk */
    const struct kiln_batch batch = kiln_batch_taken_by(r->batch, keep, r);
    const struct vulkan_hemisphere pass = vulkan_gather_pass(r->b, &batch, own);
    return vulkan_hemisphere_run(r->b, &pass, &batch, &r->rays, error);
}

/* ---- pairs ---- */

static int prepare(void *context, struct kiln_error *error)
{
    struct patches_run *r = context;
    int status;
    KILN_TRY(vulkan_kernel_of(r->b, &pairs_shader, false, vulkan_visibility_sight(r->b, r->p), &r->pairs, error));
    KILN_TRY(vulkan_kernel_of(r->b, &sums_shader, false, 0, &r->sums, error));
    KILN_TRY(bring_points(r, error));
    KILN_TRY(vulkan_visibility_prepare(r->b, r->p, r->batch, error));
    KILN_TRY(bring_nodes(r, error));
end:
    return status;
}

/* Bytes of a point's rows in the scratch memory. */
static size_t row_bytes(const struct patches_run *r) { return r->rows * KILN_GPU_PATCH_FLOATS * sizeof(float); }

static int record(void *context, const struct vulkan_chunk *chunk, struct vulkan_recording *recording,
                  struct kiln_error *error)
{
    (void)error;
    const struct patches_run *r = context;
    const struct vulkan_backend *b = r->b;
    const struct kiln_gpu_patches_push push = {.scene = b->scene.address,
                                               .chunk = chunk->all,
                                               .points = b->patches.address + place_of(r, chunk->tile_run_first) *
                                                                                  sizeof(struct kiln_gpu_patch),
                                               .facing = b->node_facings.address,
                                               .shapes = b->node_shapes.address,
                                               .slices = chunk->scratch,
                                               .nodes = (uint32_t)r->p->count,
                                               .nodes_a_row = r->row,
                                               .row_first = chunk->row_first,
                                               .most_factor = (float)r->p->most_factor,
                                               .most_added = (float)r->p->most_added,
                                               .sight = b->visibility.root.address,
                                               .open = chunk->scratch + row_bytes(r) * chunk->all.total};
    const bool keeps = (vulkan_visibility_sight(b, r->p) & KILN_GPU_SIGHT_KEPT) != 0;
    if (keeps && chunk->row_first == 0)
        vulkan_visibility_open(b, chunk, &push, recording);
    vulkan_record(recording, r->pairs, chunk->all.count, chunk->row_count, &push, sizeof push);
    if (!chunk->last)
        return KILN_OK;
    if (keeps)
        vulkan_visibility_close(b, chunk, &push, recording);
    const struct kiln_gpu_patches_reduce_push sums = {.scene = b->scene.address,
                                                      .chunk = chunk->all,
                                                      .slices = chunk->scratch,
                                                      .results = chunk->results,
                                                      .rays = chunk->words,
                                                      .rows = r->p->count > 0 ? r->rows : 0};
    vulkan_record(recording, r->sums, chunk->all.total, 1, &sums, sizeof sums);
    return KILN_OK;
}

/* `place`: of the batch's points. */
static void finish_point(const struct patches_run *r, uint64_t place, const struct kiln_gpu_patch_sums *sums)
{
    const struct kiln_surface *s = r->b->surface;
    const struct kiln_own_point first = kiln_own_of_global(s, s->tile_runs[r->batch->first].first);
    struct kiln_patches_result *result = &r->results[place];
    result->point = r->gathered[place];
    const double row = r->p->most_factor > 0.0 ? 1.0
                       : r->p->shot != NULL
                           ? (double)s->closing[KILN_CLOSING_FLOATS * (first.at + place) + KILN_CLOSING_SCALE]
                           : kiln_patches_row_scale(&result->point, (double)sums->row);
    const double scale = row * (double)result->point.count;
    for (int c = 0; c < 3; c++) {
        result->point.incident[c] = (float)(scale * (double)sums->incident[c]);
        result->point.irradiance[c] =
            (float)((double)result->point.count *
                    kiln_patches_closed(row, (double)sums->incident[c], (double)sums->irradiance[c]));
    }
    result->point.error = 0.0f;
    result->row_scale = (float)row;
}

static int take(void *context, size_t tile_run_first, size_t tile_run_count, const void *results, const uint32_t *words,
                struct kiln_error *error)
{
    struct patches_run *r = context;
    const struct kiln_tile_run *runs = r->b->surface->tile_runs + tile_run_first;
    const uint64_t count = kiln_tile_runs_points(runs, runs + tile_run_count - 1);
    const struct kiln_gpu_patch_sums *sums = results;
    const uint64_t first = place_of(r, tile_run_first);
    uint64_t rays = 0, known = 0, facing = 0;
#pragma omp parallel for num_threads((int)r->b->threads) reduction(+ : rays, known, facing) if (count > 1 << 14)
    for (uint64_t i = 0; i < count; i++) {
        finish_point(r, first + i, &sums[i]);
        rays += words[KILN_GPU_PAIRS_WORDS * i];
        known += words[KILN_GPU_PAIRS_WORDS * i + 1];
        facing += words[KILN_GPU_PAIRS_WORDS * i + 2];
    }
    r->rays += rays;
    r->seen.answered += known;
    r->seen.asked += facing;
    return r->batch->take != NULL
               ? r->batch->take(r->batch->context, tile_run_first, tile_run_count, r->results + first, error)
               : KILN_OK;
}

static int run_pairs(struct patches_run *r, struct kiln_error *error)
{
    const uint32_t nodes = (uint32_t)r->p->count;
    r->row = ROW;
    r->rows = nodes > 0 ? (nodes + r->row - 1) / r->row : 1;
    const struct vulkan_chunked chunked = {.pass = &kiln_pass_patches,
                                           .pace = KILN_PASS_INDEX_patches,
                                           .states = true,
                                           .result_bytes = sizeof(struct kiln_gpu_patch_sums),
                                           .failed_offset = offsetof(struct kiln_gpu_patch_sums, row),
                                           .rows = r->rows,
                                           .work = nodes > 0 ? (double)nodes / r->rows : 1.0,
                                           .first_guess = 1 << 19,
                                           .scratch_bytes = row_bytes(r) + vulkan_visibility_scratch(r->b, r->p),
                                           .wants_words = true,
                                           .words = KILN_GPU_PAIRS_WORDS,
                                           .prepare = prepare,
                                           .record = record,
                                           .take = take,
                                           .context = r};
    const bool keeps = (vulkan_visibility_sight(r->b, r->p) & KILN_GPU_SIGHT_KEPT) != 0;
    int status = vulkan_run_in_chunks(r->b, &chunked, r->batch, error);
    if (status == KILN_OK && keeps)
        status = vulkan_visibility_count(r->b, &r->seen, error);
    if (keeps)
        kiln_visibility_cache_tell(r->p->cache, &r->seen);
    return status;
}

static int run(struct vulkan_backend *b, const void *parameters, const struct kiln_batch *batch, uint64_t *rays,
               struct kiln_error *error)
{
    const struct kiln_tile_run *runs = b->surface->tile_runs + batch->first;
    struct patches_run r = {.b = b, .p = parameters, .batch = batch};
    const size_t points = (size_t)kiln_tile_runs_points(runs, runs + batch->count - 1);
    int status;
    KILN_TRY(kiln_allocate(&r.gathered, points, sizeof *r.gathered, "what the rays of patches meet", error));
    KILN_TRY(kiln_allocate(&r.results, points, sizeof *r.results, "the light of patches", error));
    if (r.p->shot != NULL)
        recall(&r, points);
    else
        KILN_TRY(gather(&r, error));
    KILN_TRY(run_pairs(&r, error));
end:
    *rays += r.rays;
    kiln_free(&r.gathered);
    kiln_free(&r.results);
    return status;
}

static void give_back(struct vulkan_backend *b)
{
    gpu_buffer_destroy(b->gpu, &b->patches);
    gpu_buffer_destroy(b->gpu, &b->node_facings);
    gpu_buffer_destroy(b->gpu, &b->node_shapes);
    vulkan_visibility_release(b);
}

const struct vulkan_pass vulkan_pass_patches = {.run = run, .release = give_back};
