#include "worker/backend/vulkan/hemisphere.h"

#include <assert.h>
#include <string.h>

#include "worker/backend/vulkan/groups.h"
#include "worker/backend/hand_over.h"
#include "worker/base/memory.h"
#include "worker/sampling/keys.h"
#include "worker/scene/radiance_probes.h"

/* Number of threads that follow chains: enough to fill a GPU. */
enum { CHAIN_THREADS = 1 << 18 };

struct hemisphere {
    struct vulkan_backend *b;
    const struct vulkan_hemisphere *pass;
    const struct kiln_batch *batch;
    struct gpu_kernel *whole, *reduce;
    struct gpu_kernel *between;                          /* NULL: none */
    struct gpu_kernel *apart, *apart_begin, *apart_sums; /* likewise */
    struct gpu_kernel *buried;                           /* compiled when the first such point occurs: it takes long */
    struct kiln_slices slices;
    uint64_t rays;
};

/* The push constants of the first kernel. */
struct constants {
    struct kiln_gpu_hemisphere_push shared;
    unsigned char own[VULKAN_HEMISPHERE_OWN];
};

/* Advances an address in an array over the batch's points to the chunk's first point. */
static void skip_points(const struct hemisphere *h, const struct vulkan_chunk *chunk, uint64_t *address)
{
    const struct kiln_surface *s = h->b->surface;
    const uint64_t first = s->tile_runs[h->batch->first].first.at, here = s->tile_runs[chunk->tile_run_first].first.at;
    *address += (here - first) * h->pass->point_bytes;
}

/* Bytes of a point's slices. */
static size_t slice_bytes(const struct hemisphere *h)
{
    return (size_t)4 * h->slices.per_quarter * h->slices.split * h->pass->floats * sizeof(float);
}

/* Address of the chunk's extra memory, room_bytes per point. */
static uint64_t room_of(const struct hemisphere *h, const struct vulkan_chunk *chunk)
{
    return chunk->scratch + (uint64_t)chunk->all.total * slice_bytes(h);
}

/* Sets the addresses where keep.comp writes weights and rows. */
static void name_rows(const struct hemisphere *h, const struct vulkan_chunk *chunk, uint64_t own[2])
{
    const struct vulkan_hemisphere *pass = h->pass;
    const uint64_t room = room_of(h, chunk);
    own[0] = pass->room_bytes > pass->row_bytes ? room + (uint64_t)chunk->all.total * pass->row_bytes : 0;
    own[1] = pass->kept_words > 0 ? chunk->words : room;
}

static void constants_of(const struct hemisphere *h, const struct vulkan_chunk *chunk, struct constants *constants)
{
    const uint32_t samples = h->batch->samples;
    *constants = (struct constants){.shared = {.scene = h->b->scene.address,
                                               .chunk = chunk->all,
                                               .hemisphere = {.sobol = vulkan_sobol_from(h->b, h->batch->first_sample),
                                                              .slices = chunk->scratch,
                                                              .samples = samples,
                                                              .stream = h->pass->stream,
                                                              .reuse = kiln_position_reuse(samples),
                                                              .sobol_stride = h->b->sobol_count,
                                                              .per_quarter = h->slices.per_quarter,
                                                              .row_first = chunk->row_first,
                                                              .slice = h->slices.samples,
                                                              .row_step = h->slices.split,
                                                              .first_sample = h->batch->first_sample}}};
    if (h->pass->own != NULL)
        memcpy(constants->own, h->pass->own, h->pass->own_bytes);
    uint64_t *own = (uint64_t *)(void *)constants->own;
    if (h->pass->asks_probes)
        own[0] = h->b->probes_root.address;
    if (h->pass->asks_probes)
        own[1] = chunk->near_probes;
    if (h->pass->bring != NULL)
        own[1] = h->b->slots[chunk->slot].guides.address;
    else if (h->pass->besides != NULL)
        name_rows(h, chunk, own);
    else if (h->pass->kept_words > 0)
        own[1] = chunk->words;
    else if (h->pass->point_bytes > 0)
        skip_points(h, chunk, own + 1);
}

/* Bytes per point for separately followed chains, and the few bytes per chunk: shaders/apart.glsl. */
static size_t apart_bytes(const struct hemisphere *h)
{
    const size_t rows = (size_t)4 * h->slices.per_quarter * h->slices.split;
    return h->pass->apart == NULL ? 0
                                  : KILN_GPU_APART_COUNT_BYTES + rows * sizeof(uint32_t) +
                                        h->batch->samples * (sizeof(uint32_t) + h->pass->apart_ray_bytes);
}

static struct kiln_gpu_chains_push chains_of(const struct hemisphere *h, const struct vulkan_chunk *chunk)
{
    const uint32_t split = h->slices.split;
    const uint64_t rays = (uint64_t)chunk->all.total * chunk->row_count * h->slices.samples;
    const bool software = gpu_about(h->b->gpu)->software; /* which ends a thread's loops after a number of iterations */
    return (struct kiln_gpu_chains_push){.scene = h->b->scene.address,
                                         .both = h->pass->apart_both != NULL ? *h->pass->apart_both : 0,
                                         .room = room_of(h, chunk),
                                         .slices = chunk->scratch,
                                         .points = chunk->all.total,
                                         .samples = h->batch->samples,
                                         .rows = 4 * h->slices.per_quarter * split,
                                         .threads = (uint32_t)(software || rays < CHAIN_THREADS ? rays : CHAIN_THREADS),
                                         .row_first = chunk->row_first * split,
                                         .row_last = (chunk->row_first + chunk->row_count) * split,
                                         .per_quarter = h->slices.per_quarter * split,
                                         .slice = h->slices.samples / split,
                                         .ray_bytes = (uint32_t)h->pass->apart_ray_bytes};
}

/* Resets the number of chains, before the rays of a portion. */
static void record_no_chains(const struct hemisphere *h, const struct vulkan_chunk *chunk,
                             struct vulkan_recording *recording)
{
    const struct kiln_gpu_chains_push push = chains_of(h, chunk);
    if (h->apart != NULL)
        vulkan_record(recording, h->apart_begin, 1, 1, &push, sizeof push);
}

/* After them. */
static void record_chains(const struct hemisphere *h, const struct vulkan_chunk *chunk,
                          struct vulkan_recording *recording)
{
    const struct kiln_gpu_chains_push push = chains_of(h, chunk);
    if (h->apart == NULL)
        return;
    vulkan_record(recording, h->apart, push.threads, 1, &push, sizeof push);
    vulkan_record(recording, h->apart_sums, push.points, push.row_last - push.row_first, &push, sizeof push);
}

static void record_sums(const struct hemisphere *h, const struct vulkan_chunk *chunk,
                        struct vulkan_recording *recording)
{
    const struct kiln_gpu_guided_reduce_push push = {.scene = h->b->scene.address,
                                                     .chunk = chunk->all,
                                                     .slices = chunk->scratch,
                                                     .results = chunk->results,
                                                     .rays = chunk->words,
                                                     .samples = h->batch->samples,
                                                     .per_quarter = h->slices.per_quarter,
                                                     .split = h->slices.split,
                                                     .guided = h->b->slots[chunk->slot].guides.address};
    _Static_assert(offsetof(struct kiln_gpu_guided_reduce_push, guided) ==
                       sizeof(struct kiln_gpu_hemisphere_reduce_push),
                   "they begin the same");
    const size_t bytes = h->pass->bring != NULL ? sizeof push : sizeof(struct kiln_gpu_hemisphere_reduce_push);
    if (h->between != NULL)
        vulkan_record(recording, h->between, chunk->all.total, 1, &push, bytes);
    vulkan_record(recording, h->reduce, chunk->all.total, 1, &push, bytes);
}

/* Records the first kernel for a portion of a chunk, and the kernels that follow chains apart. Partly buried points get
 * a dispatch of their own, whose kernel draws buried positions again. */
static int record_rays(struct hemisphere *h, const struct vulkan_chunk *chunk, struct vulkan_recording *recording,
                       struct kiln_error *error)
{
    const struct vulkan_hemisphere *pass = h->pass;
    const int status = chunk->buried.count > 0
                           ? vulkan_kernel_of(h->b, pass->shader, true, pass->constant, &h->buried, error)
                           : KILN_OK;
    if (status != KILN_OK)
        return status;
    struct constants push, buried;
    constants_of(h, chunk, &push);
    buried = push;
    buried.shared.chunk = chunk->buried;
    buried.shared.hemisphere.per_quarter *= h->slices.split;
    buried.shared.hemisphere.row_first *= h->slices.split;
    buried.shared.hemisphere.slice /= h->slices.split;
    buried.shared.hemisphere.row_step = 1;
    const struct vulkan_dispatch both[2] = {
        {h->buried, chunk->buried.count, chunk->row_count * h->slices.split, &buried},
        {h->whole, chunk->all.count, chunk->row_count, &push}};
    record_no_chains(h, chunk, recording);
    vulkan_record_both(recording, both, sizeof push.shared + pass->own_bytes);
    record_chains(h, chunk, recording);
    return KILN_OK;
}

static int record(void *context, const struct vulkan_chunk *chunk, struct vulkan_recording *recording,
                  struct kiln_error *error)
{
    struct hemisphere *h = context;
    const struct vulkan_hemisphere *pass = h->pass;
    const uint64_t room = room_of(h, chunk);
    int status = KILN_OK;
    if (pass->besides != NULL && chunk->row_first == 0)
        KILN_TRY(vulkan_groups_room(h->b, chunk, error));
    if (pass->bring != NULL && chunk->row_first == 0)
        KILN_TRY(pass->bring(h->b, pass->parameters, h->batch, chunk, room, recording, error));
    if (pass->shader != NULL)
        KILN_TRY(record_rays(h, chunk, recording, error));
    if (chunk->last && pass->finish != NULL)
        pass->finish(h->b, pass->parameters, chunk, room, recording);
    else if (chunk->last)
        record_sums(h, chunk, recording);
    if (chunk->last && pass->besides != NULL) {
        pass->besides(h->b, pass->parameters, chunk, room, recording);
        vulkan_groups_bring(h->b, chunk, recording);
    }
end:
    return status;
}

/* Whether an own point traces rays. */
static bool traces(const struct hemisphere *h, struct kiln_own_point own)
{
    const struct kiln_surface *s = h->b->surface;
    const bool asks_at_once = h->pass->asks_probes && !(h->b->probes->grid.range > 0.0f);
    return kiln_point_valid(s, own) && !(asks_at_once && (s->near_probes[own.at] & KILN_PROBE_SEEN) != 0);
}

/* Bytes of a point's result on the device. */
static size_t result_bytes(const struct vulkan_hemisphere *pass)
{
    return pass->lengthen != NULL || pass->finish != NULL ? pass->result_bytes : pass->pass->result_bytes;
}

/* Adds the tile runs' rays. */
static void count_rays(struct hemisphere *h, size_t tile_run_first, size_t tile_run_count, const uint32_t *words)
{
    const struct kiln_surface *s = h->b->surface;
    const struct kiln_tile_run *tile_runs = s->tile_runs + tile_run_first;
    const uint64_t first = kiln_own_of_global(s, tile_runs[0].first).at,
                   count = kiln_tile_runs_points(tile_runs, tile_runs + tile_run_count - 1);
    uint64_t tracing = 0, shadow_rays = 0;
#pragma omp parallel for num_threads((int)h->b->threads) reduction(+ : tracing, shadow_rays) if (count > 1 << 14)
    for (size_t f = 0; f < tile_run_count; f++) {
        const uint64_t points = kiln_batch_points(h->batch, tile_run_first + f),
                       run = kiln_own_of_global(s, tile_runs[f].first).at;
        if (kiln_batch_leaves_out(h->batch, tile_run_first + f))
            continue;
        for (uint32_t k = 0; k < tile_runs[f].count; k++) {
            tracing += (points >> k & 1u) != 0 && traces(h, (struct kiln_own_point){run + k});
            shadow_rays += h->pass->counts_rays ? words[run + k - first] : 0;
        }
    }
    h->rays += tracing * h->batch->samples + shadow_rays;
}

static int take(void *context, size_t tile_run_first, size_t tile_run_count, const void *results, const uint32_t *words,
                struct kiln_error *error)
{
    struct hemisphere *h = context;
    const struct kiln_batch *batch = h->batch;
    int status = KILN_OK;
    if (h->pass->holds)
        return KILN_OK;
    if (h->pass->besides != NULL)
        status = vulkan_groups_take(h->b, batch, tile_run_first, tile_run_count, error);
    if (status == KILN_OK && h->pass->kept_words > 0)
        status = h->pass->take_words(h->pass->context, tile_run_first, tile_run_count, results, words, error);
    if (status != KILN_OK)
        return status;
    count_rays(h, tile_run_first, tile_run_count, words);
    if (h->pass->lengthen != NULL)
        return vulkan_take_short(h->b, h->pass->lengthen, h->pass->result_bytes, batch, tile_run_first, tile_run_count,
                                 results, error);
    return kiln_batch_hand_over(batch, h->b->surface, h->pass->pass->result_bytes, tile_run_first, tile_run_count,
                                results, error);
}

static int prepare(void *context, struct kiln_error *error)
{
    struct hemisphere *h = context;
    const struct vulkan_hemisphere *pass = h->pass;
    /* a single light gets at most as many samples as there are rays, rounded up */
    int status;
    KILN_TRY(vulkan_sobol(h->b, h->batch->first_sample + h->batch->samples + (pass->counts_rays ? 1 : 0), error));
    if (pass->shader != NULL)
        KILN_TRY(vulkan_kernel_of(h->b, pass->shader, false, pass->constant, &h->whole, error));
    if (pass->sums != NULL)
        KILN_TRY(vulkan_kernel_of(h->b, pass->sums, false, pass->sums_constant, &h->reduce, error));
    if (pass->apart != NULL)
        KILN_TRY(vulkan_kernel_of(h->b, pass->apart, false, 0, &h->apart, error));
    if (pass->apart != NULL)
        KILN_TRY(vulkan_kernel_of(h->b, pass->apart_sums, false, 1, &h->apart_begin, error));
    if (pass->apart != NULL)
        KILN_TRY(vulkan_kernel_of(h->b, pass->apart_sums, false, pass->apart_constant, &h->apart_sums, error));
    if (pass->prepare != NULL)
        KILN_TRY(pass->prepare(h->b, pass->context, error));
    if (pass->between != NULL)
        KILN_TRY(vulkan_kernel_of(h->b, pass->between, false, 0, &h->between, error));
end:
    return status;
}

/* Slices of a point. Chains are long loops, so with chains all points get the slices that otherwise only partly buried
 * ones have. */
static struct kiln_slices slices_of(const struct vulkan_backend *b, const struct vulkan_hemisphere *pass,
                                    uint32_t samples)
{
    struct kiln_slices s = vulkan_slices_of(b, samples);
    if (pass->few_slices && s.split == 1)
        return (struct kiln_slices){.samples = s.samples * s.per_quarter, .per_quarter = 1, .split = 1};
    if (!pass->chains)
        return s;
    return (struct kiln_slices){.samples = s.samples / s.split, .per_quarter = s.per_quarter * s.split, .split = 1};
}

int vulkan_hemisphere_run(struct vulkan_backend *b, const struct vulkan_hemisphere *pass,
                          const struct kiln_batch *batch, uint64_t *rays, struct kiln_error *error)
{
    assert(pass->own_bytes <= VULKAN_HEMISPHERE_OWN);
    struct hemisphere h = {
        .b = b, .pass = pass, .batch = batch, .slices = slices_of(b, pass, batch->samples), .rays = 0};
    const uint32_t rows = pass->shader != NULL ? 4 * h.slices.per_quarter : 1;
    const size_t group_bytes = pass->besides != NULL ? vulkan_groups_floats(b) * sizeof(float) : 0;
    const struct vulkan_chunked chunked = {.pass = pass->pass,
                                           .pace = pass->pace,
                                           .states = true,
                                           .result_bytes = result_bytes(pass),
                                           .holds = pass->holds,
                                           .failed_offset = pass->failed_offset,
                                           .rows = rows,
                                           .work = (double)batch->samples / rows,
                                           .first_guess = 1 << 19,
                                           .scratch_bytes = slice_bytes(&h) + pass->room_bytes + apart_bytes(&h),
                                           .keeps_rays = pass->apart != NULL,
                                           .wants_words = pass->counts_rays || pass->kept_words > 0,
                                           .words = pass->kept_words,
                                           .moved_bytes =
                                               pass->moved_bytes + pass->kept_words * sizeof(uint32_t) + group_bytes,
                                           .takes_some = pass->besides == NULL && pass->kept_words == 0,
                                           .prepare = prepare,
                                           .record = record,
                                           .take = take,
                                           .context = &h,
                                           .seconds = pass->seconds};
    const int status = vulkan_run_in_chunks(b, &chunked, batch, error);
    *rays += h.rays;
    return status;
}
