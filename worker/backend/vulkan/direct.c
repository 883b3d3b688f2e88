/* The direct pass (worker/pass/direct.h): shaders/choose.comp, direct_pilot.comp, direct.comp, direct_precise.comp and
 * direct_reduce.comp over the batch's points; direct_groups.comp where the light of groups is found besides. */
#include "worker/backend/vulkan/answers.h"
#include "worker/backend/vulkan/chunks.h"
#include "worker/backend/vulkan/groups.h"
#include "worker/pass/direct.h"

#include "shaders/shared/sun_pilot.h"

static const struct vulkan_shader choose_shader = {
    .name = "direct: choices of lights", .compute = VULKAN_CODE(choose), .compute_float = VULKAN_CODE(choose_float)};
static const struct vulkan_shader pilot_shader = {.name = "direct: pilots",
                                                  .compute = VULKAN_CODE(direct_pilot),
                                                  .pipeline = VULKAN_CODE(direct_pilot_pipeline),
                                                  .compute_float = VULKAN_CODE(direct_pilot_float),
                                                  .pipeline_float = VULKAN_CODE(direct_pilot_pipeline_float)};
static const struct vulkan_shader direct_shader = {.name = "direct",
                                                   .compute = VULKAN_CODE(direct),
                                                   .pipeline = VULKAN_CODE(direct_pipeline),
                                                   .compute_float = VULKAN_CODE(direct_float),
                                                   .pipeline_float = VULKAN_CODE(direct_pipeline_float)};
static const struct vulkan_shader direct_precise_shader = {.name = "direct: near lights",
                                                           .compute = VULKAN_CODE(direct_precise),
                                                           .pipeline = VULKAN_CODE(direct_precise_pipeline)};
static const struct vulkan_shader sums_shader = {
    .name = "direct: sums", .compute = VULKAN_CODE(direct_reduce), .compute_float = VULKAN_CODE(direct_reduce_float)};
static const struct vulkan_shader groups_shader = {.name = "direct: sums of groups",
                                                   .compute = VULKAN_CODE(direct_groups),
                                                   .compute_float = VULKAN_CODE(direct_groups_float)};

enum { CLEARS = 1, SUMS = 0 }; /* of direct_groups.comp */

struct direct {
    struct vulkan_backend *b;
    const struct kiln_batch *batch;
    bool precise;          /* near lights may need doubles, which the device has */
    bool pilots;           /* directional lights have them */
    uint32_t most;         /* samples of a choice */
    uint32_t first_sample; /* first sample in its sequence; with pilots a range has room for the largest number */
    uint32_t samples;      /* of each point; 0: they differ */
    struct gpu_kernel *choose, *pilot, *whole, *near, *reduce;
    uint32_t groups; /* number of groups whose light is computed as well; 0: none */
    struct gpu_kernel *clear, *group_sums;
    struct gpu_kernel *buried; /* compiled when the first such point occurs, since that takes long */
    uint32_t limit, slots;
    struct kiln_slices slices; /* of the point that has most */
    size_t result_bytes;       /* on the device */
    uint64_t rays;
};

static const struct kiln_lights *lights_of(const struct vulkan_backend *b)
{
    return b->params.direct_lights != NULL ? b->params.direct_lights : b->params.lights;
}

/* The scene with these. */
static uint64_t scene_of(const struct vulkan_backend *b)
{
    return b->params.direct_lights != NULL ? b->direct_scene.address : b->scene.address;
}

static int prepare_groups(struct direct *d, struct kiln_error *error)
{
    vulkan_groups_begin(d->b);
    int status;
    KILN_TRY(vulkan_kernel_of(d->b, &groups_shader, false, CLEARS, &d->clear, error));
    KILN_TRY(vulkan_kernel_of(d->b, &groups_shader, false, SUMS, &d->group_sums, error));
    KILN_TRY(vulkan_groups_of_lights(d->b, error));
end:
    return status;
}

static int prepare(void *context, struct kiln_error *error)
{
    struct direct *d = context;
    /* a single choice gets all samples, rounded up at most */
    int status;
    KILN_TRY(vulkan_sobol(d->b, d->first_sample + d->most + 1, error));
    KILN_TRY(vulkan_kernel_of(d->b, &choose_shader, false, 0, &d->choose, error));
    if (d->pilots)
        KILN_TRY(vulkan_kernel_of(d->b, &pilot_shader, false, 0, &d->pilot, error));
    KILN_TRY(vulkan_kernel_of(d->b, &direct_shader, false, d->groups > 0, &d->whole, error));
    if (d->precise)
        KILN_TRY(vulkan_kernel_of(d->b, &direct_precise_shader, false, d->groups > 0, &d->near, error));
    KILN_TRY(vulkan_kernel_of(d->b, &sums_shader, false, VULKAN_SHORT, &d->reduce, error));
end:
    return status == KILN_OK && d->groups > 0 ? prepare_groups(d, error) : status;
}

/* Number of rows for a point with this number of samples per choice. */
static uint32_t rows_of(const struct direct *d, uint32_t samples)
{
    const struct kiln_slices s = vulkan_slices_of(d->b, (d->pilots ? KILN_SUN_TIMES : 1) * samples);
    return samples > 0 ? 4 * s.per_quarter * s.split : 0;
}

/* Bytes of scratch memory for a point with this number of rows, see struct kiln_gpu_direct: includes 8 bytes, more than
 * its place needs. */
static size_t scratch_of_rows(const struct direct *d, size_t rows)
{
    const size_t choice = sizeof(struct kiln_gpu_choice) + rows * sizeof(float);
    return rows * vulkan_lights_sums_bytes(d->b->float64) + d->slots * choice + (d->pilots ? 2 : 1) * sizeof(uint32_t) +
           (d->samples == 0 ? 8 : 0) + rows * vulkan_groups_floats(d->b) * sizeof(float);
}

/* Bytes of scratch memory, for struct vulkan_chunked, if points differ in their samples. */
static size_t scratch_of(void *context, size_t tile_run)
{
    const struct direct *d = context;
    return scratch_of_rows(d, rows_of(d, d->batch->samples_each[tile_run - d->batch->first]));
}

/* Finds where the rows of the chunk's points begin; returns the number of rows. `places` may be NULL. */
static uint32_t place_rows(const struct direct *d, const struct vulkan_chunk *chunk, uint32_t *places)
{
    const struct kiln_tile_run *runs = d->b->surface->tile_runs;
    uint32_t all = 0;
    for (size_t f = chunk->tile_run_first, end = f + chunk->tile_run_count; f < end; f++) {
        const uint32_t count = runs[f].count;
        for (uint32_t k = 0; places != NULL && k < count; k++)
            *places++ = (all + k) | (count - 1) << KILN_GPU_DIRECT_ROW_BITS;
        all += count * rows_of(d, d->batch->samples_each[f - d->batch->first]);
    }
    return all;
}

/* Uploads the places, before the first portion. */
static int record_places(struct direct *d, const struct vulkan_chunk *chunk, struct vulkan_recording *recording,
                         struct kiln_error *error)
{
    struct vulkan_slot *slot = &d->b->slots[chunk->slot];
    const size_t bytes = chunk->all.total * sizeof(uint32_t);
    const int status = vulkan_slot_room(d->b, slot, bytes, "the places of points' sums", error);
    if (status != KILN_OK)
        return status;
    (void)place_rows(d, chunk, slot->guides_host.mapped);
    recording->steps[recording->count++] = (struct gpu_step){.from = &slot->guides_host,
                                                             .to = &slot->scratch,
                                                             .to_offset = chunk->scratch - slot->scratch.address,
                                                             .size = bytes};
    return KILN_OK;
}

static void record_groups(const struct direct *d, const struct vulkan_chunk *chunk, struct kiln_gpu_direct_push push,
                          struct vulkan_recording *recording)
{
    push.pass.results = d->b->slots[chunk->slot].groups.address;
    vulkan_record(recording, d->group_sums, chunk->all.total, d->groups, &push, sizeof push);
    vulkan_groups_bring(d->b, chunk, recording);
}

static int record(void *context, const struct vulkan_chunk *chunk, struct vulkan_recording *recording,
                  struct kiln_error *error)
{
    struct direct *d = context;
    const bool mixed = d->samples == 0;
    int status = chunk->buried.count > 0
                     ? vulkan_kernel_of(d->b, &direct_shader, true, d->groups > 0, &d->buried, error)
                     : KILN_OK;
    if (status == KILN_OK && d->groups > 0 && chunk->row_first == 0)
        status = vulkan_groups_room(d->b, chunk, error);
    if (status == KILN_OK && mixed && chunk->row_first == 0)
        status = record_places(d, chunk, recording, error);
    if (status != KILN_OK)
        return status;
    const struct kiln_gpu_direct_push push = {
        .scene = scene_of(d->b),
        .chunk = chunk->all,
        .pass = {.results = chunk->results,
                 .sobol = vulkan_sobol_from(d->b, d->first_sample),
                 .scratch = chunk->scratch,
                 .rays = chunk->words,
                 .room = chunk->all.total,
                 .slots = d->slots,
                 .samples = d->samples,
                 .limit = d->limit,
                 .sobol_stride = d->b->sobol_count,
                 .row_first = chunk->row_first,
                 .slices = mixed ? place_rows(d, chunk, NULL) : d->slices.per_quarter,
                 .split = mixed ? 1 : d->slices.split,
                 .stream = d->batch->stream,
                 .software = gpu_about(d->b->gpu)->software}};
    if (chunk->row_first == 0)
        vulkan_record(recording, d->choose, chunk->all.total, 1, &push, sizeof push);
    if (chunk->row_first == 0 && d->pilots)
        vulkan_record(recording, d->pilot, chunk->all.total, 1, &push, sizeof push);
    if (chunk->row_first == 0 && d->groups > 0)
        vulkan_record(recording, d->clear, push.pass.slices * (mixed ? 1 : 4 * push.pass.split * push.pass.room),
                      vulkan_groups_floats(d->b), &push, sizeof push);
    struct kiln_gpu_direct_push buried = push;
    buried.chunk = chunk->buried;
    buried.pass.row_first *= d->slices.split;
    buried.pass.slices *= mixed ? 1 : d->slices.split;
    buried.pass.split = 1;
    const struct vulkan_dispatch both[2] = {
        {d->buried, chunk->buried.count, chunk->row_count * d->slices.split, &buried},
        {d->whole, chunk->all.count, chunk->row_count, &push}};
    vulkan_record_both(recording, both, sizeof push);
    if (d->precise)
        vulkan_record(recording, d->near, chunk->all.count, chunk->row_count, &push, sizeof push);
    if (chunk->last)
        vulkan_record(recording, d->reduce, chunk->all.total, 1, &push, sizeof push);
    if (chunk->last && d->groups > 0)
        record_groups(d, chunk, push, recording);
    return KILN_OK;
}

static int take(void *context, size_t tile_run_first, size_t tile_run_count, const void *results, const uint32_t *words,
                struct kiln_error *error)
{
    struct direct *d = context;
    const struct kiln_tile_run *tile_runs = d->b->surface->tile_runs + tile_run_first;
    const uint64_t points = kiln_tile_runs_points(tile_runs, tile_runs + tile_run_count - 1);
    uint64_t rays = 0;
#pragma omp parallel for num_threads((int)d->b->threads) reduction(+ : rays) if (points > 1 << 14)
    for (size_t f = 0; f < tile_run_count; f++)
        for (uint32_t k = 0; k < tile_runs[f].count && !kiln_batch_leaves_out(d->batch, tile_run_first + f); k++)
            rays += words[tile_runs[f].first.at - tile_runs[0].first.at + k];
    d->rays += rays;
    const int status =
        d->groups > 0 ? vulkan_groups_take(d->b, d->batch, tile_run_first, tile_run_count, error) : KILN_OK;
    if (status != KILN_OK)
        return status;
    return vulkan_take_short(d->b, vulkan_lengthen_direct, d->result_bytes, d->batch, tile_run_first, tile_run_count,
                             results, error);
}

/* Whether area lights may be so near to points that they need doubles, and the device has them. */
static bool has_near_lights(const struct vulkan_backend *b) { return b->float64 && lights_of(b)->area_count > 0; }

/* Whether directional lights have pilots (shaders/shared/sun_pilot.h). */
static bool has_pilots(const struct vulkan_backend *b)
{
    return lights_of(b)->environment && lights_of(b)->directional_count > 0;
}

/* Slices that suffice for every point; each has room for `times` as many samples as it usually gets. */
static struct kiln_slices room_for_slices(const struct vulkan_backend *b, const struct kiln_batch *batch,
                                          uint32_t times)
{
    struct kiln_slices room = vulkan_slices_of(b, times * batch->samples);
    uint32_t rows = room.per_quarter * room.split;
    for (size_t i = 0; batch->samples_each != NULL && i < batch->count; i++)
        if (batch->samples_each[i] > 0) {
            const struct kiln_slices s = vulkan_slices_of(b, times * batch->samples_each[i]);
            room.per_quarter = s.per_quarter > room.per_quarter ? s.per_quarter : room.per_quarter;
            rows = s.per_quarter * s.split > rows ? s.per_quarter * s.split : rows;
        }
    room.split = (rows + room.per_quarter - 1) / room.per_quarter;
    return room;
}

static int run(struct vulkan_backend *b, const void *parameters, const struct kiln_batch *batch, uint64_t *rays,
               struct kiln_error *error)
{
    (void)parameters;
    const uint32_t samples = batch->samples;
    struct direct d = {.b = b, .batch = batch, .samples = batch->samples_each != NULL ? 0 : samples};
    const struct kiln_lights *lights = lights_of(b);
    const size_t tree = lights->area_count + lights->point_count;
    d.result_bytes = vulkan_answer_of_direct(b).words * sizeof(float);
    d.groups = vulkan_groups_count(b);
    d.precise = has_near_lights(b);
    d.limit = kiln_cut_limit(samples);
    d.slots = (uint32_t)((tree < d.limit ? tree : d.limit) + lights->directional_count + 1);
    d.pilots = has_pilots(b);
    d.most = d.pilots ? KILN_SUN_TIMES * samples : samples;
    d.first_sample = d.pilots ? KILN_SUN_TIMES * batch->first_sample : batch->first_sample;
    d.slices = room_for_slices(b, batch, d.pilots ? KILN_SUN_TIMES : 1);
    const uint32_t rows = 4 * d.slices.per_quarter;
    const struct vulkan_chunked pass = {.pass = &kiln_pass_direct,
                                        .pace = KILN_PASS_INDEX_direct,
                                        .states = true,
                                        .mixed = true,
                                        .result_bytes = d.result_bytes,
                                        .failed_offset = KILN_GPU_SHORT_ERROR * sizeof(float),
                                        .rows = rows,
                                        .work = (double)samples / rows,
                                        .first_guess = 1 << 18,
                                        .scratch_bytes = scratch_of_rows(&d, (size_t)rows * d.slices.split),
                                        .scratch_of = d.samples == 0 ? scratch_of : NULL,
                                        .wants_words = true,
                                        .moved_bytes = vulkan_groups_floats(b) * sizeof(float),
                                        .takes_some = d.groups == 0,
                                        .prepare = prepare,
                                        .record = record,
                                        .take = take,
                                        .context = &d};
    const int status = vulkan_run_in_chunks(b, &pass, batch, error);
    *rays += d.rays;
    return status;
}

const struct vulkan_pass vulkan_pass_direct = {
    .run = run,
    .ahead = {{.shader = &direct_shader, .draw_again = true},
              {.shader = &direct_shader},
              {.shader = &choose_shader},
              {.shader = &pilot_shader, .wanted = has_pilots},
              {.shader = &sums_shader, .own = VULKAN_SHORT},
              {.shader = &direct_precise_shader, .wanted = has_near_lights}}};
