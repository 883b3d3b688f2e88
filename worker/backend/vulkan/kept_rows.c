#include "worker/backend/vulkan/kept_rows.h"

#include <string.h>

#include "worker/backend/vulkan/groups.h"
#include "worker/backend/vulkan/held.h"
#include "worker/base/memory.h"
#include "worker/pass/gather.h"
#include "worker/pass/resident_rows.h"

static const struct vulkan_shader keep_shader = {
    .name = "gather, kept", .compute = VULKAN_CODE(keep), .pipeline = VULKAN_CODE(keep_pipeline)};
static const struct vulkan_shader weights_shader = {.name = "gather from rows: weights",
                                                    .compute = VULKAN_CODE(row_weights)};
static const struct vulkan_shader replay_shader = {.name = "gather from rows", .compute = VULKAN_CODE(replay)};
static const struct vulkan_shader replay_held_shader = {.name = "gather from rows, that stays",
                                                        .compute = VULKAN_CODE(replay_held)};
static const struct vulkan_shader groups_shader = {.name = "gather of groups", .compute = VULKAN_CODE(replay_groups)};
static const struct vulkan_shader take_shader = {.name = "gather from rows: taken over",
                                                 .compute = VULKAN_CODE(replay_take)};

enum { GROUP = 64 /* threads of a workgroup */ };

/* Bytes of rows that are read from a file at a time. */
enum { PART_BYTES = 256 << 20 };

/* A call under way. */
struct rows_run {
    struct vulkan_backend *b;
    struct kiln_rows *rows;
    uint32_t samples;      /* of the batch */
    const uint32_t *words; /* rows of `samples` words, from the first point of tile run `first` on */
    size_t first;
    uint32_t *read;                   /* buffer of words read from a file; NULL: words are in memory */
    uint8_t *there;                   /* of each tile run from `first` on */
    const uint64_t *const *lights;    /* radiosity of `count` lights; NULL: the backend's radiosity */
    uint32_t count;                   /* 1 where `lights` is NULL */
    uint64_t *mixed;                  /* `lights` side by side */
    struct vulkan_resident *resident; /* rows stored on the device; NULL: they are uploaded */
    const struct kiln_batch *batch;   /* being replayed */
    uint64_t light_words, row_words;  /* addresses: of lights; of the row of the batch's first point, if resident */
    struct gpu_kernel *gather, *take, *powers;
    bool holds; /* the lights stay on the device (held), and so do the answers */
    /* For the light of groups, which is gathered as well: whether rows are traced in the same call, else uploaded; and
     * bytes per point for such rows, which are kept only for this. */
    bool traced;
    size_t room_rows;
    struct gpu_kernel *groups;
};

static size_t words_of_row(const struct rows_run *r) { return 1 + (size_t)r->samples; }

bool vulkan_keeps_rows(const struct vulkan_backend *b)
{
    return b->probes == NULL && !b->materials.gloss && b->params.geometry->passage < KILN_PASSAGE_TINT;
}

/* Returns the status of the pass; a failure of the rows counts as its own. */
static int end(const struct rows_run *r, int status, struct kiln_error *error)
{
    return status == KILN_OK && r->rows->status != KILN_OK
               ? kiln_fail(error, r->rows->status, "%s", r->rows->error.message)
               : status;
}

/* ---- keeping ---- */

/* Writes the rows of a tile run's computed points; there is room for their checksums. */
static void write_run(const struct rows_run *r, const struct kiln_tile_run *run,
                      const struct kiln_point_result *results, uint32_t *words)
{
    const uint64_t first = run->first.at;
    for (uint32_t k = 0, next; k < run->count; k = next) {
        for (next = k; next < run->count && results[next].count > 0; next++) {
            uint32_t *row = words + next * words_of_row(r);
            row[0] = kiln_rows_check(r->rows->key, first + next, row + 1, r->samples);
            if (r->samples != r->rows->samples)
                (void)kiln_rows_store(r->rows, row, first + next, 1, r->samples);
        }
        if (next > k && r->samples == r->rows->samples)
            (void)kiln_rows_store(r->rows, words + k * words_of_row(r), first + k, next - k, r->samples);
        next += next == k;
    }
}

static int take_words(void *context, size_t tile_run_first, size_t tile_run_count, const void *results,
                      const uint32_t *words, struct kiln_error *error)
{
    const struct rows_run *r = context;
    const struct kiln_tile_run *runs = r->b->surface->tile_runs + tile_run_first;
    const struct kiln_point_result *of = results;
    uint32_t *rows = (uint32_t *)(uintptr_t)words;
#pragma omp parallel for num_threads((int)r->b->threads) schedule(dynamic, 64) if (tile_run_count > 64)
    for (size_t f = 0; f < tile_run_count; f++) {
        const uint64_t at = runs[f].first.at - runs[0].first.at;
        write_run(r, &runs[f], of + at, rows + at * words_of_row(r));
    }
    return end(r, KILN_OK, error);
}

static int prepare_groups(struct vulkan_backend *b, void *context, struct kiln_error *error);
static void gather_groups(struct vulkan_backend *b, const void *parameters, const struct vulkan_chunk *chunk,
                          uint64_t room, struct vulkan_recording *recording);

/* Bytes of a point's weights in scenes with smooth normals: shaders/row_weights.comp. */
static size_t weight_bytes(const struct rows_run *r)
{
    return r->b->constants[VULKAN_HAS_SMOOTH] != 0 ? 2 * sizeof(float) * r->samples : 0;
}

/* Extends the tracing pass so that it gathers the light of groups as well. `kept`: it keeps rows for the host. */
static void add_groups(struct rows_run *r, struct vulkan_hemisphere *pass, bool kept)
{
    r->traced = true;
    r->room_rows = kept ? 0 : words_of_row(r) * sizeof(uint32_t);
    pass->shader = &keep_shader;
    pass->besides = gather_groups;
    pass->row_bytes = r->room_rows;
    pass->room_bytes = r->room_rows + weight_bytes(r);
    pass->prepare = prepare_groups;
    pass->context = r;
    pass->parameters = r;
}

/* Traces the batch, and keeps the hits of rays, unless they are in a file that is only read. */
static int trace(struct rows_run *r, const struct kiln_batch *batch, uint64_t *rays, struct kiln_error *error)
{
    const bool keeps = !r->rows->replays || r->rows->resident != NULL;
    const uint64_t own[2] = {0, 0}, before = *rays;
    struct vulkan_hemisphere pass = vulkan_gather_pass(r->b, batch, own);
    if (keeps) {
        pass.shader = &keep_shader;
        pass.kept_words = (uint32_t)words_of_row(r);
        pass.take_words = take_words;
        pass.context = r;
    }
    if (r->b->base.given.groups != NULL)
        add_groups(r, &pass, keeps);
    const int status = vulkan_hemisphere_run(r->b, &pass, batch, rays, error);
    if (keeps)
        r->rows->kept += *rays - before;
    if (r->rows->replays)
        r->rows->traced += *rays - before;
    return status;
}

/* ---- rows on the device ---- */

void vulkan_rows_release(struct vulkan_backend *b)
{
    for (size_t i = 0; i < b->resident_count; i++) {
        gpu_buffer_destroy(b->gpu, &b->resident[i].words);
        kiln_free(&b->resident[i].there);
    }
    b->resident_count = 0;
}

/* Allocates the rows on the device; *resident NULL: not enough memory. */
static int make_resident(struct vulkan_backend *b, const struct kiln_rows *rows, struct vulkan_resident **resident,
                         struct kiln_error *error)
{
    const uint64_t bytes = rows->resident->count * kiln_rows_row_bytes(rows->samples);
    struct vulkan_resident made = {.of = rows->resident, .key = rows->key};
    *resident = NULL;
    if (bytes > gpu_memory_left(b->gpu) / 2)
        return KILN_OK;
    int status;
    KILN_TRY(kiln_grow(&b->resident, &b->resident_room, b->resident_count + 1, sizeof *b->resident,
                       "rows on the device", error));
    KILN_TRY(kiln_allocate(&made.there, b->surface->tile_run_count, 1, "rows on the device", error));
    KILN_TRY(gpu_buffer_create(b->gpu, &made.words, bytes, GPU_DEVICE, "kept rays", error));
end:
    if (status != KILN_OK) {
        kiln_free(&made.there);
        return status;
    }
    *resident = &b->resident[b->resident_count++];
    **resident = made;
    return KILN_OK;
}

static int find_resident(struct vulkan_backend *b, const struct kiln_rows *rows, struct vulkan_resident **resident,
                         struct kiln_error *error)
{
    for (size_t i = 0; i < b->resident_count; i++)
        if (b->resident[i].of == rows->resident && b->resident[i].key == rows->key) {
            *resident = &b->resident[i];
            return KILN_OK;
        }
    return make_resident(b, rows, resident, error);
}

/* Uploads the batch's tile runs that are not on the device yet. */
static int fill_resident(const struct rows_run *r, struct kiln_error *error)
{
    const struct kiln_batch *batch = r->batch;
    const struct kiln_tile_run *runs = r->b->surface->tile_runs;
    const struct kiln_resident_rows *rows = r->rows->resident;
    const size_t row = (size_t)kiln_rows_row_bytes(rows->samples);
    uint8_t *there = r->resident->there;
    int status = KILN_OK;
    for (size_t f = batch->first, next; f < batch->first + batch->count && status == KILN_OK; f = next) {
        const bool wanted = there[f] == 0 && !kiln_batch_leaves_out(batch, f);
        for (next = f + 1;
             wanted && next < batch->first + batch->count && there[next] == 0 && !kiln_batch_leaves_out(batch, next);)
            next++;
        if (!wanted)
            continue;
        const uint64_t place = runs[f].first.at - rows->first,
                       points = kiln_tile_runs_points(&runs[f], &runs[next - 1]);
        status = gpu_upload(r->b->gpu, &r->resident->words, (size_t)place * row, kiln_resident_row(rows, place),
                            (size_t)points * row, error);
        if (status == KILN_OK)
            memset(there + f, 1, next - f);
    }
    return status;
}

/* ---- replaying ---- */

/* Callback vulkan_hemisphere.bring: uploads the rows of a chunk. */
static int bring(struct vulkan_backend *b, const void *parameters, const struct kiln_batch *batch,
                 const struct vulkan_chunk *chunk, uint64_t room, struct vulkan_recording *recording,
                 struct kiln_error *error)
{
    (void)batch, (void)room;
    const struct rows_run *r = parameters;
    struct vulkan_slot *slot = &b->slots[chunk->slot];
    const struct kiln_tile_run *runs = b->surface->tile_runs;
    const uint64_t place = runs[chunk->tile_run_first].first.at - runs[r->first].first.at;
    const size_t bytes = chunk->all.total * words_of_row(r) * sizeof(uint32_t);
    const int status = vulkan_slot_room(b, slot, bytes, "rows of a chunk", error);
    if (status != KILN_OK)
        return status;
    memcpy(slot->guides_host.mapped, r->words + place * words_of_row(r), bytes);
    vulkan_record_copy(recording, &slot->guides_host, &slot->guides, bytes);
    return KILN_OK;
}

/* Where the rows of a chunk begin. */
static uint64_t rows_of(const struct rows_run *r, const struct vulkan_chunk *chunk)
{
    const struct kiln_tile_run *runs = r->b->surface->tile_runs;
    const uint64_t place = runs[chunk->tile_run_first].first.at - runs[r->batch->first].first.at;
    return r->resident == NULL ? r->b->slots[chunk->slot].guides.address
                               : r->row_words + place * words_of_row(r) * sizeof(uint32_t);
}

/* Number of threads for `total` points under `lights` lights: shaders/replay.glsl. */
static uint32_t threads_of(uint32_t total, uint32_t lights)
{
    const uint32_t points = GROUP / KILN_ROW_LANES(lights);
    return (total + points - 1) / points * GROUP;
}

static struct kiln_gpu_replay_push push_of(const struct rows_run *r, const struct vulkan_chunk *chunk)
{
    const struct kiln_surface *s = r->b->surface;
    const struct kiln_slices slices = vulkan_slices_of(r->b, r->samples);
    return (struct kiln_gpu_replay_push){.scene = r->b->scene.address,
                                         .chunk = chunk->all,
                                         .held = r->b->held.root.address,
                                         .first = kiln_own_of_global(s, s->tile_runs[chunk->tile_run_first].first).at,
                                         .samples = r->samples,
                                         .slice = slices.samples,
                                         .split = slices.split};
}

/* Callback vulkan_hemisphere.finish: computes the sums of a chunk, and processes them. Its extra memory holds the
 * weights of rays, then the answers that stay on the device. */
static void finish(struct vulkan_backend *b, const void *parameters, const struct vulkan_chunk *chunk, uint64_t room,
                   struct vulkan_recording *recording)
{
    (void)b;
    const struct rows_run *r = parameters;
    const uint32_t total = chunk->all.total, groups = (total + GROUP - 1) / GROUP;
    struct kiln_gpu_replay_push push = push_of(r, chunk);
    push.lights = r->light_words;
    push.rows = rows_of(r, chunk);
    push.weights = room;
    push.results = r->holds ? room + total * weight_bytes(r) : chunk->results;
    const struct kiln_gpu_held_push powers = {.scene = push.scene, .held = push.held, .groups = groups};
    vulkan_record(recording, r->gather, threads_of(total, r->count), 1, &push, sizeof push);
    if (!r->holds)
        return;
    vulkan_record(recording, r->take, groups * GROUP, 1, &push, sizeof push);
    vulkan_record(recording, r->powers, GROUP * KILN_GPU_HELD_POWERS, r->count, &powers, sizeof powers);
}

/* ---- the light of groups ---- */

/* Number of groups of lights that are gathered at once. */
static uint32_t groups_at_once(const struct vulkan_backend *b)
{
    const uint32_t count = vulkan_groups_count(b);
    return count < KILN_ROW_LIGHTS ? count : KILN_ROW_LIGHTS;
}

/* vulkan_hemisphere.prepare */
static int prepare_groups(struct vulkan_backend *b, void *context, struct kiln_error *error)
{
    struct rows_run *r = context;
    vulkan_groups_begin(b);
    const int status = vulkan_kernel_of(b, &groups_shader, false, groups_at_once(b), &r->groups, error);
    return status == KILN_OK ? vulkan_groups_radiosity(b, error) : status;
}

/* vulkan_hemisphere.besides */
static void gather_groups(struct vulkan_backend *b, const void *parameters, const struct vulkan_chunk *chunk,
                          uint64_t room, struct vulkan_recording *recording)
{
    const struct rows_run *r = parameters;
    const uint32_t total = chunk->all.total, count = vulkan_groups_count(b), some = groups_at_once(b);
    struct kiln_gpu_replay_push push = push_of(r, chunk);
    push.lights = b->group_lights.address;
    push.rows = r->room_rows > 0 ? room : r->traced ? chunk->words : rows_of(r, chunk);
    push.weights = room + total * r->room_rows;
    push.results = b->slots[chunk->slot].groups.address;
    push.groups = count;
    push.points = (uint32_t)b->surface->point_count;
    vulkan_record(recording, r->groups, threads_of(total, some), (count + some - 1) / some, &push, sizeof push);
}

int vulkan_gather_groups(struct vulkan_backend *b, struct vulkan_hemisphere *pass, const struct kiln_batch *batch,
                         uint64_t *rays, struct kiln_error *error)
{
    struct rows_run r = {.b = b, .samples = batch->samples};
    add_groups(&r, pass, false);
    return vulkan_hemisphere_run(b, pass, batch, rays, error);
}

/* ---- replaying: the pass ---- */

static int bring_lights(struct rows_run *r, struct kiln_error *error)
{
    struct vulkan_backend *b = r->b;
    const size_t bytes = (size_t)b->surface->point_count * r->count * sizeof *r->mixed;
    r->light_words = r->holds ? b->held.layout.from : b->radiosity_buffer.address;
    if (r->lights == NULL)
        return KILN_OK;
    int status = vulkan_grow_buffer(b, &b->row_lights, bytes, GPU_DEVICE, "the radiosity of states", error);
    if (status == KILN_OK)
        status = gpu_upload(b->gpu, &b->row_lights, 0, r->mixed, bytes, error);
    r->light_words = b->row_lights.address;
    return status;
}

/* vulkan_hemisphere.prepare */
static int prepare(struct vulkan_backend *b, void *context, struct kiln_error *error)
{
    struct rows_run *r = context;
    int status =
        vulkan_kernel_of(b, r->holds ? &replay_held_shader : &replay_shader, false, r->count, &r->gather, error);
    KILN_TRY(status);
    if (r->holds)
        KILN_TRY(vulkan_kernel_of(b, &take_shader, false, r->count, &r->take, error));
    if (r->holds)
        KILN_TRY(vulkan_kernel_of(b, &vulkan_held_powers, false, 0, &r->powers, error));
    KILN_TRY(bring_lights(r, error));
    if (b->base.given.groups != NULL)
        KILN_TRY(prepare_groups(b, r, error));
end:
    if (status != KILN_OK || r->resident == NULL)
        return status;
    status = find_resident(b, r->rows, &r->resident, error);
    if (status == KILN_OK && r->resident == NULL)
        status = kiln_fail(error, KILN_NO_DEVICE, "the device has no room any more for rays that are kept on it");
    if (status == KILN_OK)
        status = fill_resident(r, error);
    if (status == KILN_OK)
        r->row_words =
            r->resident->words.address + (b->surface->tile_runs[r->batch->first].first.at - r->rows->resident->first) *
                                             words_of_row(r) * sizeof(uint32_t);
    return status;
}

/* Replays tile runs whose rows are all available. */
static int replay(struct rows_run *r, const struct kiln_batch *batch, struct kiln_error *error)
{
    const bool stays = r->read == NULL;
    uint64_t rays = 0;
    int status = stays ? find_resident(r->b, r->rows, &r->resident, error) : KILN_OK;
    if (status != KILN_OK)
        return status;
    r->batch = batch;
    r->traced = false;
    r->room_rows = 0;
    const struct vulkan_hemisphere pass = {
        .pass = &kiln_pass_gather,
        .shader = weight_bytes(r) > 0 ? &weights_shader : NULL,
        .few_slices = true,
        .finish = finish,
        .besides = r->b->base.given.groups != NULL ? gather_groups : NULL,
        .pace = VULKAN_PACE_REPLAY,
        .stream = batch->stream,
        .failed_offset = offsetof(struct kiln_gpu_result, error),
        .result_bytes = r->holds ? 0 : r->count * sizeof(struct kiln_gpu_result),
        .holds = r->holds,
        .prepare = prepare,
        .context = r,
        .parameters = r,
        .bring = r->resident == NULL ? bring : NULL,
        .moved_bytes = r->resident == NULL ? words_of_row(r) * sizeof(uint32_t) : 0,
        .room_bytes = weight_bytes(r) + (r->holds ? r->count * KILN_GPU_REPLAY_FLOATS * sizeof(float) : 0)};
    status = vulkan_hemisphere_run(r->b, &pass, batch, &rays, error);
    r->rows->found += rays;
    return status;
}

/* ---- which rows are there ---- */

/* Reads the rows of a tile run, unless they are in memory, and checks that all wanted ones are there. */
static bool look(const struct rows_run *r, const struct kiln_batch *batch, size_t f)
{
    const struct kiln_surface *s = r->b->surface;
    const struct kiln_tile_run *run = &s->tile_runs[f];
    const uint64_t first = run->first.at, asked = kiln_batch_points(batch, f),
                   own = kiln_own_of_global(s, run->first).at;
    uint32_t *read = r->read != NULL ? r->read + (first - s->tile_runs[r->first].first.at) * words_of_row(r) : NULL;
    const bool whole = r->samples == r->rows->samples;
    if (read == NULL && r->rows->resident->ready[f] != 0)
        return true;
    if (read != NULL && whole && !kiln_rows_load(r->rows, read, first, run->count, r->samples))
        return false;
    for (uint32_t k = 0; k < run->count; k++) {
        if ((asked >> k & 1u) == 0 || !kiln_point_valid(s, (struct kiln_own_point){own + k}))
            continue;
        if (read != NULL && !whole && !kiln_rows_load(r->rows, read + k * words_of_row(r), first + k, 1, r->samples))
            return false;
        const uint32_t *row = read != NULL ? read + k * words_of_row(r)
                                           : kiln_resident_row(r->rows->resident, first + k - r->rows->resident->first);
        if (!kiln_rows_there(r->rows, row, first + k, r->samples, s->point_count))
            return false;
    }
    return true;
}

/* Finds the tile runs in a part of the batch that have all their rows; one that is left out counts with the one before.
 */
static int look_at(struct rows_run *r, const struct kiln_batch *part, struct kiln_error *error)
{
    r->first = part->first;
#pragma omp parallel for num_threads((int)r->b->threads) schedule(dynamic, 16) if (part->count > 16)
    for (size_t i = 0; i < part->count; i++)
        r->there[i] = !kiln_batch_leaves_out(part, part->first + i) && look(r, part, part->first + i);
    for (size_t i = 1; i < part->count; i++)
        if (kiln_batch_leaves_out(part, part->first + i))
            r->there[i] = r->there[i - 1];
    return end(r, KILN_OK, error);
}

/* Number of tile runs from `first` on that are checked together. */
static size_t part_of(const struct rows_run *r, const struct kiln_batch *batch, size_t first)
{
    const struct kiln_tile_run *runs = r->b->surface->tile_runs;
    const size_t end_ = batch->first + batch->count;
    size_t f = first + 1;
    if (r->read == NULL)
        return end_ - first;
    while (f < end_ && kiln_tile_runs_points(&runs[first], &runs[f]) * words_of_row(r) * sizeof(uint32_t) <= PART_BYTES)
        f++;
    return f - first;
}

static int run_part(struct rows_run *r, const struct kiln_batch *part, uint64_t *rays, struct kiln_error *error)
{
    int status = look_at(r, part, error);
    for (size_t i = 0, next; i < part->count && status == KILN_OK; i = next) {
        for (next = i + 1; next < part->count && r->there[next] == r->there[i];)
            next++;
        const struct kiln_batch piece = kiln_batch_range(part, part->first + i, next - i);
        status = r->there[i] != 0 ? replay(r, &piece, error) : trace(r, &piece, rays, error);
    }
    return status;
}

/* Allocates the buffer for reading rows, unless they are in memory. */
static int make_room(struct rows_run *r, const struct kiln_batch *batch, struct kiln_error *error)
{
    const struct kiln_tile_run *runs = r->b->surface->tile_runs + batch->first;
    const size_t all = (size_t)kiln_tile_runs_points(runs, runs + batch->count - 1) * words_of_row(r),
                 most = PART_BYTES / sizeof *r->read + KILN_TILE_TEXELS * words_of_row(r);
    const bool stays = r->rows->resident != NULL && r->samples == r->rows->samples;
    int status = kiln_allocate(&r->there, batch->count, 1, "the rows of a batch", error);
    if (status == KILN_OK && !stays)
        status = kiln_allocate(&r->read, all < most ? all : most, sizeof *r->read, "the rows of a batch", error);
    return status;
}

int vulkan_gather_rows(struct vulkan_backend *b, const struct kiln_batch *batch, uint64_t *rays,
                       struct kiln_error *error)
{
    struct rows_run r = {.b = b, .rows = b->base.given.rows, .samples = batch->samples, .count = 1};
    if (!r.rows->replays)
        return trace(&r, batch, rays, error);
    int status = make_room(&r, batch, error);
    for (size_t first = batch->first, count; first < batch->first + batch->count && status == KILN_OK; first += count) {
        count = part_of(&r, batch, first);
        r.words = r.read != NULL ? r.read
                                 : kiln_resident_row(r.rows->resident,
                                                     b->surface->tile_runs[first].first.at - r.rows->resident->first);
        const struct kiln_batch part = kiln_batch_range(batch, first, count);
        status = run_part(&r, &part, rays, error);
    }
    kiln_free(&r.there);
    kiln_free(&r.read);
    return status;
}

/* ---- many lights ---- */

static void mix(const struct rows_run *r)
{
    const uint64_t points = r->b->surface->point_count;
#pragma omp parallel for num_threads((int)r->b->threads) if (points > 1 << 14)
    for (uint64_t i = 0; i < points; i++)
        for (uint32_t l = 0; l < r->count; l++)
            r->mixed[i * r->count + l] = r->lights[l][i];
}

int vulkan_replay(struct kiln_backend *backend, struct kiln_rows *rows, const uint64_t *const *lights, size_t count,
                  const struct kiln_batch *batch, struct kiln_error *error)
{
    struct vulkan_backend *b = (struct vulkan_backend *)backend;
    struct rows_run r = {.b = b,
                         .rows = rows,
                         .samples = batch->samples,
                         .first = batch->first,
                         .lights = lights,
                         .count = (uint32_t)count};
    r.words = kiln_resident_row(rows->resident, b->surface->tile_runs[batch->first].first.at - rows->resident->first);
    int status = kiln_allocate(&r.mixed, (size_t)b->surface->point_count * count, sizeof *r.mixed,
                               "the radiosity of states", error);
    if (status == KILN_OK) {
        mix(&r);
        status = replay(&r, batch, error);
    }
    kiln_free(&r.mixed);
    return status;
}

/* ---- light that stays ---- */

int vulkan_hold_step(struct kiln_backend *backend, struct kiln_rows *rows, const struct kiln_batch *batch,
                     const struct kiln_held_step *step, struct kiln_held_power *powers, struct kiln_error *error)
{
    struct vulkan_backend *b = (struct vulkan_backend *)backend;
    struct rows_run r = {
        .b = b, .rows = rows, .samples = batch->samples, .first = batch->first, .count = b->held.count, .holds = true};
    r.words = kiln_resident_row(rows->resident, b->surface->tile_runs[batch->first].first.at - rows->resident->first);
    int status;
    KILN_TRY(vulkan_held_begin(b, step, batch->stream, error));
    KILN_TRY(replay(&r, batch, error));
    KILN_TRY(vulkan_held_end(b, powers, error));
end:
    return status == KILN_OK ? KILN_OK : vulkan_held_fail(b, status, error);
}
