/* The links pass (worker/pass/links.h). The gather pass's rays measure the losses of rows. Links that are not stored
 * are found (link_views.h). shaders/links.comp and links_reduce.comp sum up the stored links, which lie in rows of a
 * fixed length, so that the order of sums depends on nothing else. */
#include "worker/base/arena.h"
#include "worker/pass/links.h"

#include <string.h>
#include <xxhash.h>

#include "worker/backend/vulkan/hemisphere.h"
#include "worker/backend/vulkan/link_views.h"
#include "worker/base/memory.h"

static const struct vulkan_shader links_shader = {
    .name = "links", .compute = VULKAN_CODE(links), .compute_float = VULKAN_CODE(links_float)};
static const struct vulkan_shader sums_shader = {.name = "links: sums", .compute = VULKAN_CODE(links_reduce)};

static const char WHAT[] = "the links of points";

enum { PIECES = 64 }; /* that hashes are made of */

/* A call's working set. */
struct links_run {
    struct vulkan_backend *b;
    const struct kiln_links_parameters *p;
    const struct kiln_batch *batch;
    struct kiln_point_result *gathered; /* of the batch's points: ray statistics; empty for points with stored links */
    struct kiln_point_result *results;
    struct kiln_kept_links **made; /* new links, by the batch's tile runs; NULL: stored ones are used */
    struct gpu_kernel *kernel, *sums;
    uint32_t rows;      /* of the tile run with most links */
    double links_a_row; /* mean */
    size_t a_point;     /* mean bytes uploaded per point */
    uint64_t rays;
    uint64_t key; /* vulkan_links_key */
    struct kiln_arena arena;
};

/* Returns the index of a tile run's first point among the batch's points. */
static uint64_t place_of(const struct links_run *r, size_t tile_run)
{
    const struct kiln_tile_run *runs = r->b->surface->tile_runs;
    return runs[tile_run].first.at - runs[r->batch->first].first.at;
}

/* The links of a tile run; NULL: it is left out. */
static const struct kiln_kept_links *links_of(const struct links_run *r, size_t tile_run)
{
    const struct kiln_kept_links *made = r->made[tile_run - r->batch->first];
    return made != NULL ? made : r->p->kept != NULL ? r->p->kept[tile_run] : NULL;
}

/* ---- rays that measure losses ---- */

/* kiln_take_results */
static int keep(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    (void)error;
    const struct links_run *r = context;
    const struct kiln_tile_run *runs = &r->b->surface->tile_runs[first];
    memcpy(r->gathered + place_of(r, first), results,
           (size_t)kiln_tile_runs_points(runs, runs + count - 1) * sizeof *r->gathered);
    return KILN_OK;
}

/* Selects tile runs whose rays must measure losses: their numbers of samples, 0 for others. False: none. */
static bool ask_rays(const struct links_run *r, uint32_t *samples)
{
    bool any = false;
    for (size_t i = 0; i < r->batch->count; i++) {
        const struct kiln_kept_links *kept = r->p->kept != NULL ? r->p->kept[r->batch->first + i] : NULL;
        const bool asks = kept == NULL || kiln_link_run_is_to_judge(r->p, kept);
        samples[i] = asks && !kiln_batch_leaves_out(r->batch, r->batch->first + i) ? r->batch->samples : 0;
        any = any || samples[i] > 0;
    }
    return any;
}

static int gather(struct links_run *r, size_t points, struct kiln_error *error)
{
    const uint64_t own[2] = {0, 0}; /* filled in for each chunk */
    struct kiln_batch batch = kiln_batch_taken_by(r->batch, keep, r);
    uint32_t *samples = NULL;
    size_t room = 0;
    int status = kiln_allocate(&samples, batch.count, sizeof *samples, "the links that are missing", error);
    batch.samples_each = samples;
    batch.stream = r->p->stream;
    const bool missing = status == KILN_OK && ask_rays(r, samples);
    if (missing)
        status = kiln_arena_grow(&r->arena, &r->gathered, &room, points, sizeof *r->gathered,
                                 "what the rays of links meet", error);
    if (missing && status == KILN_OK) {
        const struct vulkan_hemisphere pass = vulkan_gather_pass(r->b, &batch, own);
        status = vulkan_hemisphere_run(r->b, &pass, &batch, &r->rays, error);
    }
    kiln_free(&samples);
    return status;
}

/* ---- the tree on the device ---- */

bool vulkan_links_there(const struct vulkan_backend *b, int which, uint64_t key)
{
    return b->links[which].size > 0 && b->link_keys[which] == key;
}

int vulkan_links_bring(struct vulkan_backend *b, int which, uint64_t key, const void *data, size_t bytes,
                       struct kiln_error *error)
{
    struct gpu_buffer *buffer = &b->links[which];
    int status = vulkan_grow_buffer(b, buffer, bytes, GPU_DEVICE, WHAT, error);
    if (status == KILN_OK && bytes > 0)
        status = gpu_upload(b->gpu, buffer, 0, data, bytes, error);
    b->link_keys[which] = status == KILN_OK ? key : 0;
    return status;
}

/* Combines a hash with that of data, computed by all threads from the hashes of pieces. */
static uint64_t add_key(const struct vulkan_backend *b, uint64_t key, const void *data, size_t bytes)
{
    uint64_t hashes[PIECES];
    const size_t piece = bytes / PIECES + 1;
#pragma omp parallel for num_threads((int)b->all_threads) if (bytes > 1 << 22)
    for (size_t i = 0; i < PIECES; i++) {
        const size_t begin = i * piece < bytes ? i * piece : bytes, rest = bytes - begin;
        hashes[i] = XXH3_64bits((const char *)data + begin, rest < piece ? rest : piece);
    }
    return XXH3_64bits_withSeed(hashes, sizeof hashes, key);
}

uint64_t vulkan_links_key(const struct vulkan_backend *b, const struct kiln_links_parameters *p)
{
    const size_t count = p->node_count > 0 ? (size_t)p->count : 0;
    const uint64_t points = add_key(b, count, p->points, (size_t)b->surface->point_count * sizeof *p->points);
    return add_key(b, points, p->order, count * sizeof *p->order);
}

static struct kiln_gpu_link_node node_of(const struct kiln_link_node *n)
{
    struct kiln_gpu_link_node to = {.centre = n->centre,
                                    .normal = n->normal,
                                    .radius = n->radius,
                                    .height = n->height,
                                    .bend = n->bend,
                                    .area = n->area,
                                    .most_area = n->most_area,
                                    .first = n->first,
                                    .count = n->count};
    memcpy(to.covariance, n->covariance, sizeof to.covariance);
    return to;
}

static int bring_nodes(const struct links_run *r, struct kiln_error *error)
{
    const uint64_t key = add_key(r->b, r->p->node_count, r->p->nodes, r->p->node_count * sizeof *r->p->nodes);
    struct kiln_gpu_link_node *nodes = NULL;
    if (vulkan_links_there(r->b, VULKAN_LINK_NODES, key))
        return KILN_OK;
    int status = kiln_allocate(&nodes, r->p->node_count, sizeof *nodes, WHAT, error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for num_threads((int)r->b->threads) if (r->p->node_count > 1 << 14)
    for (uint32_t i = 0; i < r->p->node_count; i++)
        nodes[i] = node_of(&r->p->nodes[i]);
    status = vulkan_links_bring(r->b, VULKAN_LINK_NODES, key, nodes, r->p->node_count * sizeof *nodes, error);
    kiln_free(&nodes);
    return status;
}

static int bring_leaves(const struct links_run *r, struct kiln_error *error)
{
    const size_t count = r->p->node_count > 0 ? (size_t)r->p->count : 0;
    const uint64_t key = r->key;
    struct kiln_gpu_link_leaf *leaves = NULL;
    if (vulkan_links_there(r->b, VULKAN_LINK_LEAVES, key))
        return KILN_OK;
    int status = kiln_allocate(&leaves, count, sizeof *leaves, WHAT, error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for num_threads((int)r->b->threads) if (count > 1 << 14)
    for (size_t k = 0; k < count; k++) {
        const struct kiln_patch *p = &r->p->points[r->p->order[k]];
        leaves[k] = (struct kiln_gpu_link_leaf){p->centre, p->normal, p->edge_s, p->edge_t, p->area};
    }
    status = vulkan_links_bring(r->b, VULKAN_LINK_LEAVES, key, leaves, count * sizeof *leaves, error);
    kiln_free(&leaves);
    return status;
}

/* Uploads the light of nodes, followed by that of points. */
static int bring_light(const struct links_run *r, struct kiln_error *error)
{
    const struct kiln_links_parameters *p = r->p;
    const size_t nodes = p->node_count, count = nodes > 0 ? (size_t)p->count : 0, of_nodes = nodes * sizeof *p->sent,
                 bytes = of_nodes + count * sizeof(struct kiln_gpu_link_leaf_light);
    const uint64_t key = add_key(r->b, add_key(r->b, nodes, p->sent, of_nodes), p->leaves, count * sizeof *p->leaves);
    char *light = NULL;
    size_t room = 0;
    if (vulkan_links_there(r->b, VULKAN_LINK_LIGHT, key))
        return KILN_OK;
    int status = kiln_grow(&light, &room, bytes, 1, WHAT, error); /* not zero: all of it is written */
    if (status != KILN_OK)
        return status;
    _Static_assert(sizeof *p->sent == sizeof(struct kiln_gpu_link_sent), "they are the same");
    struct kiln_gpu_link_sent *sent = (struct kiln_gpu_link_sent *)(void *)light;
    struct kiln_gpu_link_leaf_light *leaves = (struct kiln_gpu_link_leaf_light *)(void *)(light + of_nodes);
#pragma omp parallel for num_threads((int)r->b->threads) if (nodes > 1 << 14)
    for (size_t i = 0; i < nodes; i++)
        memcpy(&sent[i], &p->sent[i], sizeof *sent);
#pragma omp parallel for num_threads((int)r->b->threads) if (count > 1 << 14)
    for (size_t k = 0; k < count; k++) {
        const struct kiln_link_leaf *l = &p->leaves[k];
        leaves[k] =
            (struct kiln_gpu_link_leaf_light){{l->radiosity[0], l->radiosity[1], l->radiosity[2]}, l->now, l->before};
    }
    status = vulkan_links_bring(r->b, VULKAN_LINK_LIGHT, key, light, bytes, error);
    kiln_free(&light);
    return status;
}

static int prepare(void *context, struct kiln_error *error)
{
    struct links_run *r = context;
    int status;
    KILN_TRY(vulkan_kernel_of(r->b, &links_shader, false, 0, &r->kernel, error));
    KILN_TRY(vulkan_kernel_of(r->b, &sums_shader, false, 0, &r->sums, error));
    KILN_TRY(bring_nodes(r, error));
    KILN_TRY(bring_leaves(r, error));
    KILN_TRY(bring_light(r, error));
end:
    return status;
}

/* ---- a chunk's links ---- */

/* Offsets of the parts of a chunk's data. */
struct layout {
    size_t runs, links, tinted, bytes; /* after the points */
};

/* Counts the chunk's links, and computes their layout. */
static int lay_out(const struct links_run *r, const struct vulkan_chunk *chunk, struct kiln_gpu_link_run *runs,
                   struct layout *layout, struct kiln_error *error)
{
    uint32_t links = 0, tinted = 0;
    for (size_t f = 0; f < chunk->tile_run_count; f++) {
        const struct kiln_kept_links *kept = links_of(r, chunk->tile_run_first + f);
        runs[f] = (struct kiln_gpu_link_run){.first = links, .tinted_first = tinted};
        if (kept == NULL || kiln_batch_leaves_out(r->batch, chunk->tile_run_first + f))
            continue;
        const int status = kiln_links_head(kept, &runs[f].count, &runs[f].tinted_count, error);
        if (status != KILN_OK)
            return status;
        links += runs[f].count;
        tinted += runs[f].tinted_count;
    }
    layout->runs = chunk->all.total * sizeof(struct kiln_gpu_linked_point);
    layout->links = layout->runs + chunk->tile_run_count * sizeof *runs;
    layout->tinted = layout->links + links * sizeof(struct kiln_gpu_link);
    layout->bytes = layout->tinted + tinted * sizeof(struct kiln_gpu_tinted_link);
    return KILN_OK;
}

static void put_mask(uint32_t to[2], uint64_t mask)
{
    to[0] = (uint32_t)mask;
    to[1] = (uint32_t)(mask >> 32);
}

/* Writes the points and links of the chunk's `number`th tile run. */
static int write_run(struct kiln_link_run *w, const struct links_run *r, const struct vulkan_chunk *chunk,
                     size_t number, const struct layout *layout, struct kiln_gpu_link_run *run, char *to,
                     struct kiln_error *error)
{
    const struct kiln_tile_run *tile_runs = r->b->surface->tile_runs + chunk->tile_run_first,
                               *tile_run = &tile_runs[number];
    struct kiln_gpu_linked_point *points =
        (struct kiln_gpu_linked_point *)(void *)to + (tile_run->first.at - tile_runs[0].first.at);
    struct kiln_gpu_link *links = (struct kiln_gpu_link *)(void *)(to + layout->links) + run->first;
    kiln_link_run_enter(w, r->b->surface, tile_run);
    put_mask(run->shares, w->shares);
    run->texel = (float)w->texel;
    for (uint32_t k = 0; k < tile_run->count; k++) {
        const struct kiln_patch *patch = w->patch[w->bit[k]];
        points[k] = (struct kiln_gpu_linked_point){patch->place, patch->normal, patch->number,
                                                   (uint32_t)number << 6 | w->bit[k]};
    }
    if (run->count + run->tinted_count == 0)
        return KILN_OK;
    const int status = kiln_link_run_take(w, links_of(r, chunk->tile_run_first + number), error);
    run->sharing = (float)kiln_links_shared(kiln_link_run_error(w));
    for (uint32_t i = 0; i < run->count && status == KILN_OK; i++) {
        links[i].to = w->found.to[i];
        put_mask(links[i].asked, w->found.asked[i]);
        put_mask(links[i].seen, w->found.seen[i]);
    }
    _Static_assert(sizeof(struct kiln_tinted_link) == sizeof(struct kiln_gpu_tinted_link), "they are the same");
    if (status == KILN_OK && run->tinted_count > 0)
        memcpy(to + layout->tinted + run->tinted_first * sizeof(struct kiln_gpu_tinted_link), w->found.tinted,
               run->tinted_count * sizeof(struct kiln_gpu_tinted_link));
    return status;
}

/* Writes all data of a chunk, by all threads. */
static int write_chunk(const struct links_run *r, const struct vulkan_chunk *chunk, const struct layout *layout,
                       struct kiln_gpu_link_run *runs, char *to, struct kiln_error *error)
{
    int status = KILN_OK;
#pragma omp parallel num_threads((int)r->b->all_threads)
    {
        struct kiln_link_run *w = NULL;
        struct kiln_error own_error;
        int own = kiln_allocate(&w, 1, sizeof *w, WHAT, &own_error);
        if (own == KILN_OK)
            w->p = r->p;
#pragma omp for schedule(dynamic, 16)
        for (size_t f = 0; f < chunk->tile_run_count; f++)
            if (own == KILN_OK)
                own = write_run(w, r, chunk, f, layout, &runs[f], to, &own_error);
#pragma omp critical(vulkan_links_chunk)
        if (own != KILN_OK && status == KILN_OK)
            status = kiln_fail(error, own, "%s", own_error.message);
        if (w != NULL)
            kiln_link_run_release(w);
        kiln_free(&w);
    }
    memcpy(to + layout->runs, runs, chunk->tile_run_count * sizeof *runs);
    return status;
}

/* Uploads a chunk's links to its slot. */
static int bring_chunk(const struct links_run *r, const struct vulkan_chunk *chunk, struct layout *layout,
                       struct vulkan_recording *recording, struct kiln_error *error)
{
    struct vulkan_slot *slot = &r->b->slots[chunk->slot];
    struct kiln_gpu_link_run *runs = NULL;
    int status;
    KILN_TRY(kiln_allocate(&runs, chunk->tile_run_count, sizeof *runs, WHAT, error));
    KILN_TRY(lay_out(r, chunk, runs, layout, error));
    if (chunk->row_first == 0) {
        KILN_TRY(vulkan_slot_room(r->b, slot, layout->bytes, "links of a chunk", error));
        KILN_TRY(write_chunk(r, chunk, layout, runs, slot->guides_host.mapped, error));
        vulkan_record_copy(recording, &slot->guides_host, &slot->guides, layout->bytes);
    }
end:
    kiln_free(&runs);
    return status;
}

static int record(void *context, const struct vulkan_chunk *chunk, struct vulkan_recording *recording,
                  struct kiln_error *error)
{
    const struct links_run *r = context;
    const struct vulkan_backend *b = r->b;
    struct layout layout;
    const int status = bring_chunk(r, chunk, &layout, recording, error);
    if (status != KILN_OK)
        return status;
    const uint64_t at = b->slots[chunk->slot].guides.address;
    const struct kiln_gpu_links_push push = {.scene = b->scene.address,
                                             .chunk = chunk->all,
                                             .points = at,
                                             .runs = at + layout.runs,
                                             .links = at + layout.links,
                                             .tinted = at + layout.tinted,
                                             .nodes = b->links[VULKAN_LINK_NODES].address,
                                             .leaves = b->links[VULKAN_LINK_LEAVES].address,
                                             .light = b->links[VULKAN_LINK_LIGHT].address,
                                             .slices = chunk->scratch,
                                             .row_first = chunk->row_first,
                                             .node_count = r->p->node_count};
    vulkan_record(recording, r->kernel, chunk->all.count, chunk->row_count, &push, sizeof push);
    if (!chunk->last)
        return KILN_OK;
    const struct kiln_gpu_links_reduce_push sums = {.scene = b->scene.address,
                                                    .chunk = chunk->all,
                                                    .points = push.points,
                                                    .runs = push.runs,
                                                    .slices = chunk->scratch,
                                                    .results = chunk->results};
    vulkan_record(recording, r->sums, chunk->all.total, 1, &sums, sizeof sums);
    return KILN_OK;
}

/* ---- answers ---- */

/* Closes the rows of new links by their sums, and passes the links to their storage. */
static void close_made(const struct links_run *r, size_t tile_run, struct kiln_linked_point point[KILN_TILE_TEXELS],
                       const struct kiln_gpu_link_sums *sums)
{
    struct kiln_kept_links **made = &r->made[tile_run - r->batch->first];
    const uint64_t mask = r->b->surface->tile_runs[tile_run].mask;
    float scale[KILN_TILE_TEXELS], shading[KILN_TILE_TEXELS][3];
    for (uint64_t rest = mask; rest != 0; rest &= rest - 1, sums++) {
        const uint32_t bit = (uint32_t)__builtin_ctzll(rest);
        scale[bit] = point[bit].scale = kiln_link_row_scale(&point[bit], (double)sums->row);
        memcpy(shading[bit], sums->shading, sizeof shading[bit]);
    }
    kiln_links_close(*made, mask, scale, (const float(*)[3])shading);
    if (r->p->kept == NULL)
        return;
    kiln_links_replace(&r->p->kept[tile_run], *made);
    *made = NULL;
}

static int take_run(const struct links_run *r, size_t tile_run, const struct kiln_gpu_link_sums *sums,
                    struct kiln_error *error)
{
    const struct kiln_tile_run *run = &r->b->surface->tile_runs[tile_run];
    struct kiln_linked_point point[KILN_TILE_TEXELS];
    struct kiln_point_result *result = r->results + place_of(r, tile_run);
    const int status = kiln_links_points(links_of(r, tile_run), run->mask, point, error);
    if (status != KILN_OK)
        return status;
    if (r->made[tile_run - r->batch->first] != NULL)
        close_made(r, tile_run, point, sums);
    if (r->p->kept != NULL)
        r->p->kept[tile_run]->is_judged = 1;
    for (uint64_t rest = run->mask; rest != 0; rest &= rest - 1, sums++, result++) {
        struct kiln_link_sums s = {.variance = (double)sums->variance};
        for (int c = 0; c < 3; c++) {
            s.incident[c] = (double)sums->incident[c];
            s.irradiance[c] = (double)sums->irradiance[c];
        }
        *result = kiln_link_answer(&point[__builtin_ctzll(rest)], &s);
    }
    return KILN_OK;
}

static int take(void *context, size_t tile_run_first, size_t tile_run_count, const void *results, const uint32_t *words,
                struct kiln_error *error)
{
    (void)words;
    struct links_run *r = context;
    const struct kiln_gpu_link_sums *sums = results;
    const uint64_t first = place_of(r, tile_run_first);
    int status = KILN_OK;
#pragma omp parallel for num_threads((int)r->b->threads) schedule(dynamic, 16) if (tile_run_count > 64)
    for (size_t f = 0; f < tile_run_count; f++) {
        struct kiln_error own_error;
        const int own = take_run(r, tile_run_first + f, sums + (place_of(r, tile_run_first + f) - first), &own_error);
#pragma omp critical(vulkan_links_chunk)
        if (own != KILN_OK && status == KILN_OK)
            status = kiln_fail(error, own, "%s", own_error.message);
    }
    return status == KILN_OK && r->batch->take != NULL
               ? r->batch->take(r->batch->context, tile_run_first, tile_run_count, r->results + first, error)
               : status;
}

/* ---- the pass ---- */

/* Finds the largest number of rows of a tile run, and mean sizes. */
static int measure(struct links_run *r, struct kiln_error *error)
{
    const struct kiln_tile_run *runs = r->b->surface->tile_runs + r->batch->first;
    uint64_t all = 0;
    r->rows = 1;
    for (size_t i = 0; i < r->batch->count; i++) {
        const struct kiln_kept_links *kept = links_of(r, r->batch->first + i);
        uint32_t count = 0, tinted = 0;
        const int status = kept != NULL ? kiln_links_head(kept, &count, &tinted, error) : KILN_OK;
        if (status != KILN_OK)
            return status;
        const uint32_t rows = (count + tinted + KILN_GPU_LINKS_A_ROW - 1) / KILN_GPU_LINKS_A_ROW;
        r->rows = rows > r->rows ? rows : r->rows;
        all += count + tinted;
    }
    r->a_point = sizeof(struct kiln_gpu_linked_point) +
                 (size_t)(all * sizeof(struct kiln_gpu_link) / kiln_tile_runs_points(runs, runs + r->batch->count - 1));
    r->links_a_row = 1.0 + (double)all / ((double)r->batch->count * r->rows);
    return KILN_OK;
}

static int add_up(struct links_run *r, struct kiln_error *error)
{
    const int status = measure(r, error);
    const struct vulkan_chunked chunked = {.pass = &kiln_pass_links,
                                           .pace = KILN_PASS_INDEX_links,
                                           .states = true,
                                           .result_bytes = sizeof(struct kiln_gpu_link_sums),
                                           .failed_offset = offsetof(struct kiln_gpu_link_sums, row),
                                           .rows = r->rows,
                                           .work = r->links_a_row,
                                           .first_guess = 1 << 19,
                                           .scratch_bytes = r->rows * KILN_GPU_LINK_FLOATS * sizeof(float),
                                           .moved_bytes = r->a_point,
                                           .prepare = prepare,
                                           .record = record,
                                           .take = take,
                                           .context = r};
    return status == KILN_OK ? vulkan_run_in_chunks(r->b, &chunked, r->batch, error) : status;
}

static void release(struct links_run *r)
{
    for (size_t i = 0; r->made != NULL && i < r->batch->count; i++)
        kiln_free(&r->made[i]);
    kiln_arena_release(&r->arena);
}

static int run(struct vulkan_backend *b, const void *parameters, const struct kiln_batch *batch, uint64_t *rays,
               struct kiln_error *error)
{
    const struct kiln_tile_run *runs = b->surface->tile_runs + batch->first;
    struct links_run r = {.b = b, .p = parameters, .batch = batch, .key = vulkan_links_key(b, parameters)};
    const size_t points = (size_t)kiln_tile_runs_points(runs, runs + batch->count - 1);
    size_t room = 0;
    int status;
    KILN_TRY(kiln_arena_allocate(&r.arena, &r.made, batch->count, sizeof(struct kiln_kept_links *), WHAT, error));
    /* filled by the threads that take answers, so not zeroed */
    KILN_TRY(kiln_arena_grow(&r.arena, &r.results, &room, points, sizeof *r.results, "the light of links", error));
    KILN_TRY(gather(&r, points, error));
    KILN_TRY(vulkan_find_links(b, r.p, batch, r.gathered, r.key, r.made, &r.rays, error));
    KILN_TRY(add_up(&r, error));
end:
    *rays += r.rays;
    release(&r);
    return status;
}

static void give_back(struct vulkan_backend *b)
{
    for (int i = 0; i < VULKAN_LINK_ARRAYS; i++)
        gpu_buffer_destroy(b->gpu, &b->links[i]);
    for (int i = 0; i < VULKAN_LINK_GROUPS; i++) {
        gpu_buffer_destroy(b->gpu, &b->link_rays[i]);
        gpu_buffer_destroy(b->gpu, &b->link_answers[i]);
    }
}

const struct vulkan_pass vulkan_pass_links = {.run = run, .release = give_back};
