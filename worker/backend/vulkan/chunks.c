#include "worker/backend/vulkan/chunks.h"

#include <assert.h>
#include <string.h>

#include "worker/base/memory.h"

/* Limits of points and rays in a chunk. Passes with few samples take more points, so that the fixed cost of a chunk
 * (its last threads, its transfer to the host) does not matter. */
enum { LEAST_POINTS = 1 << 13, USUAL_POINTS = 1 << 19, MOST_POINTS = 1 << 20, ENOUGH_RAYS = 1 << 24 };
/* Rays of a chunk that does not fit the usual scratch memory. New memory is cleared at 40 GB a second, slower with
 * several ranks at once. With memory for all points Sponza's direct light first waited for 28 GB. */
enum { FEWEST_RAYS = 1 << 22 };
/* Scratch memory if numbers of samples differ. A chunk ends with its few longest threads: Sponza took 2.3 s with 262
 * thousand points in a chunk, and 3.7 s with 32 thousand. */
#define MIXED_SCRATCH (2ull << 30) /* bytes */

/* Largest transfer of a chunk between host and device, for passes with large data per point. */
enum { MOVED_MOST = 64 << 20 };

static uint32_t words_of(const struct vulkan_chunked *pass) { return pass->words > 0 ? pass->words : 1; }

/* Bytes of a point's answer: the result and its words. */
static size_t answer_bytes(const struct vulkan_chunked *pass)
{
    return pass->result_bytes + words_of(pass) * sizeof(uint32_t);
}

void vulkan_record(struct vulkan_recording *recording, struct gpu_kernel *kernel, uint32_t x, uint32_t y,
                   const void *constants, size_t bytes)
{
    if (x == 0 || y == 0)
        return;
    struct gpu_step *step = &recording->steps[recording->count];
    uint64_t *copy = recording->constants[recording->count++];
    memcpy(copy, constants, bytes);
    *step =
        (struct gpu_step){.kernel = kernel, .threads_x = x, .threads_y = y, .constants = copy, .constant_bytes = bytes};
}

void vulkan_record_copy(struct vulkan_recording *recording, const struct gpu_buffer *from, const struct gpu_buffer *to,
                        size_t size)
{
    recording->steps[recording->count++] = (struct gpu_step){.from = from, .to = to, .size = size};
}

void vulkan_record_both(struct vulkan_recording *recording, const struct vulkan_dispatch both[2], size_t constant_bytes)
{
    const size_t first = recording->count;
    for (int i = 0; i < 2; i++)
        vulkan_record(recording, both[i].kernel, both[i].x, both[i].y, both[i].constants, constant_bytes);
    if (recording->count == first + 2)
        recording->steps[first + 1].alongside = true;
}

/* A chunk under way in a slot. */
struct flight {
    bool under_way;
    size_t tile_run_first, tile_run_count;
    uint32_t total;   /* points, */
    double weight;    /* points weighted by their samples over the batch's `samples` */
    uint64_t scratch; /* bytes */
    double work;      /* of what was submitted last */
};

/* A pass that is being run. */
struct run {
    struct vulkan_backend *b;
    const struct vulkan_chunked *pass;
    const struct kiln_batch *batch;
    size_t next, end;      /* tile runs not yet begun */
    size_t claimed;        /* end of the tile runs claimed for this device; without claims `end` */
    size_t taken;          /* first tile run not yet handed over */
    uint32_t most_points;  /* that a slot holds, */
    uint64_t most_scratch; /* and their bytes */
    struct flight flights[GPU_SLOTS];
    uint32_t slot; /* next slot to use; also the oldest flight if all are under way */
    bool refused;  /* the taker of the answers has failed, not the device */
};

int vulkan_slot_room(struct vulkan_backend *b, struct vulkan_slot *slot, size_t bytes, const char *what,
                     struct kiln_error *error)
{
    if (!gpu_guarded(b->gpu))
        bytes = bytes <= slot->guides.size ? slot->guides.size : bytes + bytes / 2;
    const int status = vulkan_grow_buffer(b, &slot->guides, bytes, GPU_DEVICE, what, error);
    return status == KILN_OK ? vulkan_grow_buffer(b, &slot->guides_host, bytes, GPU_HOST, what, error) : status;
}

static uint64_t points_there(const struct vulkan_backend *b)
{
    return b->surface->count < MOST_POINTS ? b->surface->count : MOST_POINTS;
}

/* Allocates the slots' answers and partial sums, with these numbers of bytes. */
static int make_room(struct vulkan_backend *b, uint64_t answers, uint64_t scratch, struct kiln_error *error)
{
    int status = KILN_OK;
    for (int i = 0; i < GPU_SLOTS; i++) {
        KILN_TRY(vulkan_grow_buffer(b, &b->slots[i].scratch, scratch, GPU_DEVICE, "a pass's partial sums", error));
        KILN_TRY(vulkan_grow_buffer(b, &b->slots[i].answers, answers, GPU_DEVICE, "a pass's answers", error));
        KILN_TRY(vulkan_grow_buffer(b, &b->slots[i].host, answers, GPU_HOST, "a pass's answers for the host", error));
    }
end:
    return status;
}

static uint64_t lesser(uint64_t a, uint64_t b) { return a < b ? a : b; }
static uint64_t greater(uint64_t a, uint64_t b) { return a > b ? a : b; }

/* Reserves the memory that most passes need, since allocation takes time: the usual scratch memory, at most what the
 * share's points need with many samples, and at most a quarter of the free memory. */
void vulkan_passes_ahead(struct vulkan_backend *b)
{
    const uint64_t a_slot = gpu_memory_left(b->gpu) / (4 * 2 * GPU_SLOTS); /* half of it for answers */
    const uint64_t usual = lesser(b->scratch_most, VULKAN_USUAL_SCRATCH),
                   scratch = lesser(lesser(b->surface->count << 10, usual), a_slot);
    const uint64_t answers = lesser(points_there(b) * (sizeof(struct kiln_gpu_result) + sizeof(uint32_t)), a_slot);
    (void)make_room(b, answers, scratch, NULL);
}

/* Bytes of scratch of a point of a tile run. */
static uint64_t scratch_of(const struct run *r, size_t tile_run)
{
    return r->pass->scratch_of != NULL ? r->pass->scratch_of(r->pass->context, tile_run) : r->pass->scratch_bytes;
}

/* Bytes of scratch memory for points with the batch's mean need; half as many again, since some need more. */
static uint64_t mixed_scratch(const struct run *r, uint64_t points)
{
    const struct kiln_batch *batch = r->batch;
    uint64_t count = 1, bytes = 0;
    for (size_t f = batch->first; f < batch->first + batch->count; f++) {
        const uint32_t some = kiln_batch_leaves_out(batch, f) ? 0 : r->b->surface->tile_runs[f].count;
        count += some;
        bytes += some > 0 ? some * scratch_of(r, f) : 0;
    }
    return bytes / count * points / 2 * 3;
}

/* Finds the largest number of points in a chunk that the slots can hold, and enlarges the slots accordingly, whatever
 * the size of the batch. */
static int make_slots(struct run *r, struct kiln_error *error)
{
    struct vulkan_backend *b = r->b;
    const uint64_t samples = (uint64_t)(r->pass->work * r->pass->rows) + 1, had = b->slots[0].scratch.size;
    uint64_t there =
        ENOUGH_RAYS / samples < USUAL_POINTS && !r->pass->keeps_rays ? USUAL_POINTS : ENOUGH_RAYS / samples;
    there = lesser(there, points_there(b));
    const uint64_t scratch = lesser(greater(gpu_memory_left(b->gpu) / (2 * GPU_SLOTS), had), b->scratch_most);
    const uint64_t a_point = r->pass->scratch_bytes + answer_bytes(r->pass);
    uint64_t points = scratch / a_point, bytes;
    if (r->pass->scratch_of == NULL) {
        points = lesser(points, greater(greater(had, VULKAN_USUAL_SCRATCH) / a_point, FEWEST_RAYS / samples));
        if (r->pass->moved_bytes > 0)
            points = lesser(points, MOVED_MOST / r->pass->moved_bytes);
        points = greater(lesser(points, there), KILN_TILE_TEXELS);
        bytes = points * r->pass->scratch_bytes;
    } else {
        points = greater(there, KILN_TILE_TEXELS);
        bytes = greater(lesser(lesser(mixed_scratch(r, points), MIXED_SCRATCH), scratch),
                        KILN_TILE_TEXELS * r->pass->scratch_bytes);
    }
    const int status = make_room(b, points * answer_bytes(r->pass), bytes, error);
    r->most_points = (uint32_t)points;
    r->most_scratch = gpu_guarded(b->gpu) ? bytes : lesser(b->slots[0].scratch.size, MIXED_SCRATCH);
    r->most_scratch = greater(r->most_scratch, bytes);
    return status;
}

/* First of the ascending `list` that is not below `value`. */
static uint32_t lower_bound(const uint32_t *list, uint32_t count, uint64_t value)
{
    uint32_t low = 0, high = count;
    while (low < high) {
        const uint32_t middle = low + (high - low) / 2;
        if (list[middle] < value)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

/* Sets points and rows of the next chunk: full rows, with as many points as fit into a time slice; for few points as
 * many rows as fit. */
static void size_chunk(const struct run *r, uint64_t *points, uint32_t *rows)
{
    const struct vulkan_chunked *pass = r->pass;
    const double work = (double)gpu_pacer_next(&r->b->pacers[pass->pace], pass->first_guess);
    const double a_point = pass->work * pass->rows;
    const double wanted = work / a_point;
    *points = wanted > (double)r->most_points ? r->most_points : (uint64_t)wanted;
    *rows = pass->rows;
    if (*points >= LEAST_POINTS || *points >= r->most_points)
        return;
    *points = LEAST_POINTS < r->most_points ? LEAST_POINTS : r->most_points;
    const double some = work / (pass->work * (double)*points);
    *rows = some < 1.0 ? 1 : some > (double)pass->rows ? pass->rows : (uint32_t)some;
    if (some < 1.0) /* even one row is too much */
        *points = wanted * pass->rows < KILN_TILE_TEXELS ? KILN_TILE_TEXELS : (uint64_t)(wanted * pass->rows);
}

/* Adds the next tile run to the flight; false if the flight would be too large. */
static bool take_tile_run(struct run *r, uint64_t points, struct flight *flight)
{
    const struct kiln_batch *batch = r->batch;
    const uint32_t count = r->b->surface->tile_runs[r->next].count;
    const uint32_t asked =
        batch->selections != NULL ? (uint32_t)__builtin_popcountll(kiln_batch_points(batch, r->next)) : count;
    const double share = batch->samples_each == NULL
                             ? 1.0
                             : (double)batch->samples_each[r->next - batch->first] / (double)batch->samples,
                 weight = (double)asked * share;
    const uint64_t scratch = count * scratch_of(r, r->next);
    if (flight->tile_run_count > 0 &&
        (flight->weight + weight > (double)points || flight->total + count > r->most_points ||
         flight->scratch + scratch > r->most_scratch))
        return false;
    flight->total += count;
    flight->scratch += scratch;
    flight->weight += weight;
    flight->tile_run_count++;
    r->next++;
    return true;
}

/* Takes the next tile runs of one block, at most `points` points by weight (but at least one tile run). */
static void take_tile_runs(struct run *r, const struct vulkan_point_range *block, uint64_t points,
                           struct flight *flight)
{
    size_t end = block->tile_run_first + block->tile_run_count;
    end = end > r->end ? r->end : end;
    *flight = (struct flight){.tile_run_first = r->next};
    while (r->next < end && take_tile_run(r, points, flight))
        ;
}

/* Claims tile runs up to `end`; false: other devices or ranks have them. */
static bool claim(struct run *r, size_t end)
{
    const struct kiln_claims *claims = r->batch->claims;
    const size_t claimed = claims->claim(claims->context, r->claimed, end - r->claimed);
    r->claimed += claimed;
    return claimed > 0;
}

/* Claims the flight's tile runs, and cuts off those that this device does not get; ends the run if it gets none. */
static void claim_flight(struct run *r, struct flight *flight)
{
    const size_t first = flight->tile_run_first, end = first + flight->tile_run_count;
    while (r->claimed < end) {
        if (!claim(r, end))
            r->end = r->claimed;
        if (r->claimed > first || r->claimed == r->end)
            break; /* otherwise these were earlier tile runs, which are left out */
    }
    if (r->claimed >= end)
        return;
    *flight = (struct flight){.tile_run_first = first};
    r->next = first < r->claimed ? first : r->claimed;
    while (r->next < r->claimed && take_tile_run(r, UINT64_MAX, flight))
        ;
}

/* Skips tile runs that are left out. */
static void skip_left_out(struct run *r)
{
    while (r->next < r->end && kiln_batch_leaves_out(r->batch, r->next))
        r->next++;
}

/* Restricts a chunk to the points in a list. */
static void name_points(struct kiln_gpu_chunk *chunk, const struct gpu_buffer *buffer, const uint32_t *list,
                        uint32_t count)
{
    chunk->list = buffer->address;
    chunk->first = lower_bound(list, count, chunk->origin);
    chunk->count = lower_bound(list, count, (uint64_t)chunk->origin + chunk->total) - chunk->first;
}

static void describe(const struct run *r, const struct vulkan_point_range *block, const struct flight *flight,
                     struct vulkan_chunk *chunk)
{
    const struct gpu *gpu = r->b->gpu;
    const struct vulkan_slot *slot = &r->b->slots[r->slot];
    const uint64_t results =
        slot->answers.address + gpu_buffer_tail(gpu, &slot->answers, flight->total * answer_bytes(r->pass));
    const struct kiln_surface *s = r->b->surface;
    const uint64_t first = kiln_own_of_global(s, s->tile_runs[flight->tile_run_first].first).at - block->first.at;
    *chunk =
        (struct vulkan_chunk){.scratch = slot->scratch.address + gpu_buffer_tail(gpu, &slot->scratch, flight->scratch),
                              .results = results,
                              .words = results + (uint64_t)flight->total * r->pass->result_bytes,
                              .near_probes = block->near_probes.address,
                              .tile_run_first = flight->tile_run_first,
                              .tile_run_count = flight->tile_run_count,
                              .slot = r->slot};
    gpu_buffer_forget(gpu, &slot->scratch);
    gpu_buffer_forget(gpu, &slot->answers);
    chunk->all = (struct kiln_gpu_chunk){.points = block->points.address,
                                         .parts = block->parts.address,
                                         .states = block->states.address,
                                         .first = (uint32_t)first,
                                         .count = flight->total,
                                         .origin = (uint32_t)first,
                                         .total = flight->total};
    chunk->buried = chunk->all;
    name_points(&chunk->buried, &block->list, block->buried, r->pass->states ? block->buried_count : 0);
    if (r->batch->selections != NULL) /* threads only for the points that are computed */
        name_points(&chunk->all, &block->asked_list, block->asked, block->asked_count);
}

static int wait_slot(struct run *r, uint32_t slot, struct kiln_error *error)
{
    double seconds = 0.0;
    const int status = gpu_wait(r->b->gpu, slot, &seconds, error);
    if (status == KILN_OK)
        gpu_pacer_learn(&r->b->pacers[r->pass->pace], (uint64_t)r->flights[slot].work, seconds);
    if (r->pass->seconds != NULL)
        *r->pass->seconds += seconds;
    return status;
}

/* Checks the results for loops that were ended early. Software devices end loops after some ten thousands of iterations
 * in all, silently; kernels detect this and store a negative number. */
static int check(const struct run *r, const struct flight *flight, const char *results, struct kiln_error *error)
{
    bool stopped = false;
    const size_t stride = r->pass->result_bytes, offset = r->pass->failed_offset;
#pragma omp parallel for num_threads((int)r->b->threads) reduction(|| : stopped) if (flight->total > 1 << 14)
    for (uint32_t i = 0; i < flight->total; i++)
        stopped = stopped || *(const float *)(const void *)(results + i * stride + offset) < 0.0f;
    if (stopped)
        return kiln_fail(error, KILN_NO_DEVICE,
                         "%s ends long loops early, and a surface point of object %u needs one; use another device or "
                         "--backend embree",
                         gpu_about(r->b->gpu)->name, r->b->surface->tile_runs[flight->tile_run_first].map);
    return KILN_OK;
}

/* Hands over the answers of the tile runs: with those of the ones left out, if the pass takes these. */
static int hand_over(struct run *r, const struct flight *flight, const char *results, struct kiln_error *error)
{
    const struct kiln_tile_run *tile_runs = r->b->surface->tile_runs;
    const uint32_t *words = (const uint32_t *)(const void *)(results + flight->total * r->pass->result_bytes);
    const size_t begin = flight->tile_run_first, end = begin + flight->tile_run_count;
    const bool all = r->pass->takes_some && r->batch->take_some != NULL;
    int status = KILN_OK;
    for (size_t f = begin, next; f < end && status == KILN_OK; f = next) {
        const uint64_t point = tile_runs[f].first.at - tile_runs[begin].first.at;
        next = all ? end : kiln_batch_stretch(r->batch, f, end);
        if (all || !kiln_batch_leaves_out(r->batch, f))
            status = r->pass->take(r->pass->context, f, next - f, results + point * r->pass->result_bytes,
                                   r->pass->wants_words ? words + point * words_of(r->pass) : NULL, error);
        if (status == KILN_OK)
            r->taken = next;
        r->refused = status != KILN_OK;
    }
    return status;
}

/* Waits for the flight in a slot, and passes on its answers. */
static int land(struct run *r, uint32_t slot, struct kiln_error *error)
{
    struct flight *flight = &r->flights[slot];
    if (!flight->under_way)
        return KILN_OK;
    int status = wait_slot(r, slot, error);
    flight->under_way = false;
    const char *results = r->b->slots[slot].host.mapped;
    if (status == KILN_OK && r->pass->result_bytes > 0)
        status = check(r, flight, results, error);
    return status == KILN_OK ? hand_over(r, flight, results, error) : status;
}

static int submit_portion(struct run *r, struct vulkan_chunk *chunk, struct flight *flight, struct kiln_error *error)
{
    struct vulkan_recording recording = {.count = 0};
    const struct vulkan_slot *slot = &r->b->slots[r->slot];
    int status = r->pass->record(r->pass->context, chunk, &recording, error);
    if (status != KILN_OK)
        return status;
    const size_t size = flight->total * (r->pass->wants_words ? answer_bytes(r->pass) : r->pass->result_bytes);
    r->b->returned += chunk->last ? size : 0;
    if (chunk->last && size > 0)
        recording.steps[recording.count++] = (struct gpu_step){.aside = true,
                                                               .from = &slot->answers,
                                                               .to = &slot->host,
                                                               .from_offset = chunk->results - slot->answers.address,
                                                               .size = size};
    flight->work = r->pass->work * flight->weight * (double)chunk->row_count;
    return gpu_submit(r->b->gpu, r->slot, recording.steps, recording.count, error);
}

/* Finds the block of the next tile run. If memory is short, flights under way must land first. */
static int find_block(struct run *r, struct vulkan_point_range **block, struct kiln_error *error)
{
    uint32_t in_use = 0;
    for (int i = 0; i < GPU_SLOTS; i++)
        in_use += r->flights[i].under_way;
    int status = vulkan_points_range(r->b->points, r->next, r->pass->states, in_use, block, error);
    if (status == KILN_OK || in_use == 0 || gpu_lost(r->b->gpu))
        return status;
    status = KILN_OK;
    for (uint32_t i = 0; i < GPU_SLOTS && status == KILN_OK; i++)
        status = land(r, (r->slot + i) % GPU_SLOTS, error);
    return status == KILN_OK ? vulkan_points_range(r->b->points, r->next, r->pass->states, 0, block, error) : status;
}

/* Number of rows of the chunk that fit into a time slice, by the speed measured so far. */
static uint32_t rows_now(const struct run *r, const struct flight *flight)
{
    const double work = (double)gpu_pacer_next(&r->b->pacers[r->pass->pace], r->pass->first_guess),
                 rows = work / (r->pass->work * flight->weight);
    return rows < 1.0 ? 1 : rows > (double)r->pass->rows ? r->pass->rows : (uint32_t)rows;
}

/* Starts the next chunk in r->slot, which is free. */
static int start(struct run *r, struct kiln_error *error)
{
    struct vulkan_point_range *block;
    int status = find_block(r, &block, error);
    if (status != KILN_OK)
        return status;
    uint64_t points;
    uint32_t rows;
    struct vulkan_chunk chunk;
    struct flight *flight = &r->flights[r->slot];
    size_chunk(r, &points, &rows);
    take_tile_runs(r, block, points, flight);
    claim_flight(r, flight);
    if (flight->tile_run_count == 0)
        return KILN_OK;
    describe(r, block, flight, &chunk);
    for (uint32_t row = 0; row < r->pass->rows && status == KILN_OK; row += chunk.row_count) {
        if (row != 0) {
            status = wait_slot(r, r->slot, error);
            rows = rows_now(r, flight);
        }
        chunk.row_first = row;
        chunk.row_count = r->pass->rows - row < rows ? r->pass->rows - row : rows;
        chunk.last = row + chunk.row_count == r->pass->rows;
        if (status == KILN_OK)
            status = submit_portion(r, &chunk, flight, error);
    }
    flight->under_way = status == KILN_OK;
    return status;
}

static int run_chunks(struct run *r, struct kiln_error *error)
{
    skip_left_out(r);
    int status = r->next < r->end ? make_slots(r, error) : KILN_OK;
    while (r->next < r->end && status == KILN_OK) {
        status = land(r, r->slot, error);
        if (status == KILN_OK)
            status = start(r, error);
        r->slot = (r->slot + 1) % GPU_SLOTS;
        skip_left_out(r);
    }
    for (uint32_t i = 0; i < GPU_SLOTS; i++) { /* the rest, oldest first; after a failure only waits for them */
        const uint32_t slot = (r->slot + i) % GPU_SLOTS;
        struct kiln_error ignored;
        if (status == KILN_OK)
            status = land(r, slot, error);
        else if (r->flights[slot].under_way)
            (void)gpu_wait(r->b->gpu, slot, NULL, &ignored);
        r->flights[slot].under_way = false;
    }
    return status;
}

/* Runs the part of the batch that has not been handed over yet. */
static int run_left(struct run *r, struct kiln_error *error)
{
    int status;
    KILN_TRY(r->pass->prepare(r->pass->context, error));
    if (r->pass->states) {
        vulkan_points_choose(r->b->points, r->batch, r->pass->mixed);
        KILN_TRY(vulkan_points_ready(r->b->points, error));
    }
    KILN_TRY(run_chunks(r, error));
end:
    return status;
}

int vulkan_run_in_chunks(struct vulkan_backend *b, const struct vulkan_chunked *pass, const struct kiln_batch *batch,
                         struct kiln_error *error)
{
    struct run r = {.b = b,
                    .pass = pass,
                    .batch = batch,
                    .next = batch->first,
                    .end = batch->first + batch->count,
                    .claimed = batch->first + (batch->claims == NULL ? batch->count : 0),
                    .taken = batch->first};
    int status = run_left(&r, error);
    while (status != KILN_OK && !r.refused && !pass->holds && vulkan_can_recover(b) &&
           (status = vulkan_recover(b, error)) == KILN_OK) {
        r.next = r.taken; /* do not repeat what was handed over */
        status = run_left(&r, error);
    }
    while (status == KILN_OK && r.claimed < r.end && claim(&r, r.end)) /* what comes last is left out */
        ;
    if (b->points != NULL) /* NULL if the device could not be created again */
        vulkan_points_choose(b->points, NULL, false);
    return status;
}
