/* The reference pass (worker/pass/reference.h): paths from surface points, by the kernels of the bidirectional pass
 * (bidirectional_stages.c); shaders/point_paths.comp begins and ends them. Sample by sample, all points of the batch
 * follow one path, so that a point's sums are in the order of its samples. The ray statistics that the energy ledger
 * needs come from the gather pass, which has the same rays. */
#include <math.h>
#include <string.h>

#include "shaders/shared/bidirectional.h"
#include "shaders/shared/streams.h"
#include "worker/backend/vulkan/bidirectional.h"
#include "worker/backend/vulkan/hemisphere.h"
#include "worker/base/memory.h"
#include "worker/pass/reference.h"
#include "worker/sampling/keys.h"

/* MOST_POINTS: points whose own light paths are stored at once. QUARTERS: of the samples. */
enum { MOST_POINTS = 1 << 21, QUARTERS = 4 };

/* A call's working set. */
struct reference_run {
    struct both_run both;
    struct kiln_bidirectional_parameters paths; /* only method, radius and the camera's bounces are set */
    const struct kiln_reference_parameters *wanted;
    const struct kiln_batch *batch;
    struct kiln_reference_result *results; /* of all points of the batch */
    uint64_t count;                        /* of these */
    struct kiln_gpu_both_points points;
};

/* ---- what becomes of rays ---- */

static uint64_t place_of(const struct reference_run *r, size_t tile_run)
{
    const struct kiln_tile_run *runs = r->both.b->surface->tile_runs;
    return runs[tile_run].first.at - runs[r->batch->first].first.at;
}

static int take_rays(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    struct reference_run *r = context;
    const struct kiln_tile_run *runs = r->both.b->surface->tile_runs;
    const struct kiln_point_result *from = results;
    struct kiln_reference_result *to = r->results + place_of(r, first);
    const uint64_t points = kiln_tile_runs_points(runs + first, runs + first + count - 1);
    (void)error;
    for (uint64_t i = 0; i < points; i++) {
        to[i].point = from[i];
        memset(to[i].point.irradiance, 0, sizeof to[i].point.irradiance);
        memset(to[i].point.incident, 0, sizeof to[i].point.incident);
    }
    return KILN_OK;
}

static int count_rays(struct reference_run *r, uint64_t *rays, struct kiln_error *error)
{
    const uint64_t own[2] = {0, 0};
    const struct kiln_batch batch = kiln_batch_taken_by(r->batch, take_rays, r);
    struct vulkan_hemisphere pass = vulkan_gather_pass(r->both.b, &batch, own);
    pass.stream = r->points.stream;
    return vulkan_hemisphere_run(r->both.b, &pass, &batch, rays, error);
}

/* ---- samples ---- */

static bool alone(const struct reference_run *r) { return r->wanted->method == KILN_REFERENCE_PATH; }
static bool merges(const struct reference_run *r) { return r->wanted->method == KILN_REFERENCE_VCM; }

/* Runs sample k of points first .. first + count - 1 of the batch, which are in one block. */
static int run_sample(struct reference_run *r, uint64_t first, uint64_t count, uint32_t k, struct kiln_error *error)
{
    struct both_run *both = &r->both;
    struct kiln_gpu_both_counts counts;
    int status = KILN_OK;
    both->push.sampled = r->batch->first_sample + k;
    both->light_of = KILN_GPU_OF_LIGHT_OWN;
    for (uint64_t done = 0; done < count && status == KILN_OK; done += MOST_POINTS) {
        const uint64_t left = count - done, some = left < MOST_POINTS ? left : MOST_POINTS;
        if (!alone(r))
            status = both_trace_light(both, first + done, some, &counts, error);
        if (status == KILN_OK)
            status = both_follow(both, first + done, some, error);
    }
    return status;
}

/* Prepares quarter q of the samples. With vcm, traces and sorts the light paths that may be merged with the paths of
 * all points in this quarter, as trace_quarter of worker/backend/embree/reference_paths.c. Their rays are not counted.
 */
static int begin_quarter(struct reference_run *r, uint32_t q, struct kiln_error *error)
{
    struct both_run *both = &r->both;
    const struct kiln_batch *batch = r->batch;
    const uint32_t before = batch->first_sample / batch->samples * QUARTERS + q,
                   first = batch->first_sample + (uint32_t)((uint64_t)q * batch->samples / QUARTERS);
    struct kiln_gpu_both_counts counts;
    if (merges(r)) {
        const double radius = kiln_merge_radius(r->paths.radius, before);
        both->shared.radius = (float)radius;
        both->shared.area = (float)(KILN_PI * radius * radius * (double)both->paths);
    }
    both->push.light_key = kiln_hash2(r->points.light_seed, first);
    both->light_of = KILN_GPU_OF_LIGHT;
    if (!merges(r))
        return both_upload(both, error);
    const uint64_t rays = both->rays;
    const int status = both_trace_light(both, 0, both->paths, &counts, error);
    both->rays = rays; /* these are not counted */
    return status == KILN_OK ? both_sort_photons(both, counts.vertices, error) : status;
}

/* Runs samples from .. to - 1 of points in tile runs of one block, from `tile_run` on. *next: first tile run of another
 * block. */
static int run_block(struct reference_run *r, size_t tile_run, uint32_t from, uint32_t to, size_t *next,
                     struct kiln_error *error)
{
    struct vulkan_backend *b = r->both.b;
    const struct kiln_surface *s = b->surface;
    const size_t end = r->batch->first + r->batch->count;
    struct vulkan_point_range *block;
    int status;
    KILN_TRY(vulkan_points_range(b->points, tile_run, true, 0, &block, error));
    *next = block->tile_run_first + block->tile_run_count;
    *next = *next < end ? *next : end;
    const uint64_t first = place_of(r, tile_run),
                   count = kiln_tile_runs_points(s->tile_runs + tile_run, s->tile_runs + *next - 1),
                   in_block = kiln_own_of_global(s, s->tile_runs[tile_run].first).at - block->first.at;
    r->points.points = block->points.address;
    r->points.parts = block->parts.address;
    r->points.states = block->states.address;
    r->points.origin = (uint32_t)(in_block - first);
    r->both.buried = block->buried_count > 0;
    KILN_TRY(gpu_upload(b->gpu, &r->both.points, 0, &r->points, sizeof r->points, error));
    for (uint32_t k = from; k < to; k++)
        KILN_TRY(run_sample(r, first, count, k, error));
end:
    return status;
}

static int run_samples(struct reference_run *r, struct kiln_error *error)
{
    const uint32_t samples = r->batch->samples;
    const size_t end = r->batch->first + r->batch->count;
    int status = KILN_OK;
    for (uint32_t q = 0; q < QUARTERS && status == KILN_OK; q++) {
        const uint32_t from = kiln_quarter_first(q, samples), to = kiln_quarter_first(q + 1, samples);
        if (from < to)
            status = begin_quarter(r, q, error);
        for (size_t tile_run = r->batch->first; from < to && tile_run < end && status == KILN_OK;)
            status = run_block(r, tile_run, from, to, &tile_run, error);
    }
    return status;
}

/* ---- answers ---- */

static float sum_of(const struct kiln_gpu_point_sums *s, size_t number) { return s->high[number] + s->low[number]; }

/* As rays_quarters_error of the other backend. */
static float error_of(const struct kiln_gpu_point_sums *s, uint32_t samples)
{
    double value[QUARTERS], mean = 0.0, square = 0.0;
    if (samples < QUARTERS)
        return 0.0f;
    for (size_t q = 0; q < QUARTERS; q++) {
        value[q] = ((double)s->high[9 + q] + (double)s->low[9 + q]) * QUARTERS / samples;
        mean += value[q] / QUARTERS;
    }
    for (size_t q = 0; q < QUARTERS; q++)
        square += (value[q] - mean) * (value[q] - mean);
    return (float)(samples * sqrt(square / (QUARTERS * (QUARTERS - 1))));
}

static int read_sums(struct reference_run *r, struct kiln_error *error)
{
    struct kiln_gpu_point_sums *sums = NULL;
    int status;
    KILN_TRY(kiln_allocate(&sums, r->count, sizeof *sums, "the sums of paths", error));
    KILN_TRY(gpu_download(r->both.b->gpu, &r->both.sums, 0, sums, r->count * sizeof *sums, error));
    for (uint64_t i = 0; i < r->count; i++) {
        struct kiln_reference_result *to = &r->results[i];
        if (to->point.count == 0) {            /* not valid, or left out */
            r->both.rays -= r->batch->samples; /* that had no place to begin */
            continue;
        }
        for (size_t c = 0; c < 3; c++) {
            to->point.irradiance[c] = sum_of(&sums[i], c);
            to->point.incident[c] = sum_of(&sums[i], 3 + c);
            to->last[c] = sum_of(&sums[i], 6 + c);
        }
        to->point.error = error_of(&sums[i], r->batch->samples);
    }
end:
    kiln_free(&sums);
    return status;
}

static int hand_over(const struct reference_run *r, struct kiln_batch *left, struct kiln_error *error)
{
    const size_t end = left->first + left->count;
    int status = KILN_OK;
    for (size_t f = left->first, next; f < end && status == KILN_OK && left->take != NULL; f = next) {
        next = kiln_batch_stretch(left, f, end);
        if (!kiln_batch_leaves_out(left, f))
            status = left->take(left->context, f, next - f, r->results + place_of(r, f), error);
    }
    return status;
}

/* ---- running ---- */

static int prepare(struct reference_run *r, struct kiln_error *error)
{
    struct vulkan_backend *b = r->both.b;
    const struct kiln_batch *batch = r->batch;
    const uint32_t low = (uint32_t)b->params.seed, high = (uint32_t)(b->params.seed >> 32);
    if (merges(r) && !(r->wanted->radius > 0.0))
        return kiln_fail(error, KILN_USAGE, "the reference pass: vcm merges within %g m, which must be above 0",
                         r->wanted->radius);
    int status;
    KILN_TRY(vulkan_sobol(b, batch->first_sample + batch->samples, error));
    KILN_TRY(both_prepare(&r->both, error));
    KILN_TRY(gpu_buffer_create(b->gpu, &r->both.points, sizeof r->points, GPU_DEVICE, "what paths share", error));
end:
    r->both.shared.points = r->both.points.address;
    r->points = (struct kiln_gpu_both_points){.sobol = vulkan_sobol_from(b, batch->first_sample),
                                              .paths = r->both.point_paths.address,
                                              .rays = r->both.point_rays.address,
                                              .sobol_stride = b->sobol_count,
                                              .samples = batch->samples,
                                              .reuse = kiln_position_reuse(batch->samples),
                                              .stream = r->points.stream,
                                              .first_sample = batch->first_sample,
                                              .light_seed = kiln_hash2(low, high ^ KILN_REFERENCE_LIGHT_SEED)};
    return status;
}

static void describe(struct reference_run *r)
{
    struct both_run *both = &r->both;
    const struct kiln_tile_run *runs = both->b->surface->tile_runs + r->batch->first;
    const uint32_t bounces = r->wanted->bounces;
    r->count = kiln_tile_runs_points(runs, runs + r->batch->count - 1);
    r->paths.method = merges(r) ? KILN_BIDIRECTIONAL_VCM : KILN_BIDIRECTIONAL_BDPT;
    r->paths.camera.bounces = bounces == KILN_PATH_ALL_BOUNCES ? bounces : bounces + 1; /* and the point's own */
    r->paths.radius = r->wanted->radius;
    both->p = &r->paths;
    both->method = KILN_GPU_BOTH_POINTS | KILN_GPU_BOTH_CONNECTS | (merges(r) ? KILN_GPU_BOTH_MERGES : 0u) |
                   (alone(r) ? KILN_GPU_BOTH_ALONE : 0u);
    both->count = r->count;
    r->points.stream = KILN_REFERENCE_STREAM + r->batch->stream;
    both->paths = merges(r) ? kiln_reference_paths(both->b->surface->point_count) : 1;
}

/* Runs the rest of the batch as a whole, since all of it shares the light paths that are merged. */
static int run_left(struct vulkan_backend *b, const void *parameters, struct kiln_batch *left, uint64_t *rays,
                    bool *refused, struct kiln_error *error)
{
    struct reference_run r = {.both = {.b = b}, .wanted = parameters, .batch = left};
    uint64_t counted = 0; /* the points' rays, which their paths count again */
    if (left->count == 0)
        return KILN_OK;
    describe(&r);
    int status;
    KILN_TRY(kiln_allocate(&r.results, r.count, sizeof *r.results, "the answers of points", error));
    KILN_TRY(count_rays(&r, &counted, error)); /* first: it may make the device anew */
    KILN_TRY(prepare(&r, error));
    vulkan_points_choose(b->points, left, false);
    KILN_TRY(vulkan_points_ready(b->points, error));
    KILN_TRY(run_samples(&r, error));
end:
    if (b->points != NULL)
        vulkan_points_choose(b->points, NULL, false);
    if (status == KILN_OK)
        status = read_sums(&r, error);
    if (status == KILN_OK) {
        *rays += r.both.rays;
        status = hand_over(&r, left, error);
        *refused = status != KILN_OK;
    }
    kiln_free(&r.results);
    both_finish(&r.both);
    return status;
}

static int run(struct vulkan_backend *b, const void *parameters, const struct kiln_batch *batch, uint64_t *rays,
               struct kiln_error *error)
{
    return vulkan_run_to_end(b, run_left, parameters, batch, rays, error);
}

const struct vulkan_pass vulkan_pass_reference = {.run = run};
