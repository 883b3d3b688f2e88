/* The weighed pass (worker/pass/weighed.h): runs shaders/weighed.comp over the batch's points, weighed_chains.comp over
 * the rays that have met gloss, and gather_reduce.comp. */
#include "shaders/shared/streams.h"
#include "worker/backend/vulkan/hemisphere.h"
#include "worker/base/memory.h"
#include "worker/light/aims.h"
#include "worker/pass/weighed.h"

static const struct vulkan_shader weighed_shader = {.name = "weighed", .compute = VULKAN_CODE(weighed)};
static const struct vulkan_shader chains_shader = {.name = "weighed: chains",
                                                   .compute = VULKAN_CODE(weighed_chains),
                                                   .compute_float = VULKAN_CODE(weighed_chains_float)};
static const struct vulkan_shader chains_add_shader = {.name = "weighed: sums of chains",
                                                       .compute = VULKAN_CODE(chains_add)};
static const struct vulkan_shader sums_shader = {.name = "weighed: sums", .compute = VULKAN_CODE(gather_reduce)};

/* Constants of the kernels: SURFACES as in the gather pass's LOOKUP; the others select what chains_add.comp does. */
enum { SURFACES = 1, BEGINS = 1, ADDS_WEIGHED = 2 };

/* A call's working set. */
struct weighed_run {
    const struct kiln_caustic_techniques *techniques;
    const struct kiln_batch *batch;
    uint64_t own[2]; /* both, areas: struct kiln_gpu_weighed_push */
};

/* Uploads the unburied area of each of the batch's points. The device itself accounts for transparency. */
static int upload_areas(struct vulkan_backend *b, const struct kiln_batch *batch, uint64_t *address,
                        struct kiln_error *error)
{
    const struct kiln_surface *s = b->surface;
    const struct kiln_tile_run *runs = s->tile_runs + batch->first;
    const uint64_t first = kiln_own_of_global(s, runs[0].first).at,
                   count = kiln_tile_runs_points(runs, runs + batch->count - 1);
    struct gpu_buffer *buffer = &b->techniques.areas;
    float *areas = NULL;
    int status;
    KILN_TRY(kiln_allocate(&areas, count, sizeof *areas, "the areas of points", error));
    for (uint64_t i = 0; i < count; i++)
        areas[i] = (float)kiln_lit_area(s, (struct kiln_own_point){first + i}, 1.0f);
    KILN_TRY(gpu_buffer_of(b->gpu, buffer, areas, count * sizeof *areas, "the areas of points", error));
end:
    *address = buffer->address;
    kiln_free(&areas);
    return status;
}

static int prepare(struct vulkan_backend *b, void *context, struct kiln_error *error)
{
    struct weighed_run *r = context;
    vulkan_techniques_release(b);
    int status;
    KILN_TRY(vulkan_surfaces(b, error));
    if (r->techniques->aims != NULL) /* without aims no surface bends light, and no chain begins */
        KILN_TRY(vulkan_techniques_create(b, r->techniques->aims, r->techniques, NULL, error));
    KILN_TRY(upload_areas(b, r->batch, &r->own[1], error));
end:
    r->own[0] = b->techniques.both;
    return status;
}

static int run(struct vulkan_backend *b, const void *parameters, const struct kiln_batch *batch, uint64_t *rays,
               struct kiln_error *error)
{
    struct weighed_run r = {.techniques = parameters, .batch = batch};
    const bool tints = b->params.geometry->passage >= KILN_PASSAGE_TINT;
    const struct vulkan_hemisphere pass = {.pass = &kiln_pass_weighed,
                                           .shader = &weighed_shader,
                                           .sums = &sums_shader,
                                           .chains = true,
                                           .apart = &chains_shader,
                                           .apart_sums = &chains_add_shader,
                                           .apart_ray_bytes = KILN_GPU_APART_WEIGHED_RAY_BYTES,
                                           .apart_constant = ADDS_WEIGHED,
                                           .apart_both = r.own,
                                           .constant = SURFACES,
                                           .own = r.own,
                                           .own_bytes = sizeof r.own,
                                           .prepare = prepare,
                                           .context = &r,
                                           .point_bytes = sizeof(float),
                                           .pace = KILN_PASS_INDEX_weighed,
                                           .stream = KILN_CAUSTIC_STREAM + batch->stream,
                                           .floats = tints ? KILN_GPU_SLICE_TINTED_FLOATS : KILN_GPU_SLICE_FLOATS,
                                           .failed_offset = offsetof(struct kiln_gpu_result, error)};
    const int status = vulkan_hemisphere_run(b, &pass, batch, rays, error);
    vulkan_techniques_release(b);
    return status;
}

/* Rejects mirror images (worker/pass/weighed.h), images of the sky with several cells, since here there is only one
 * (worker/light/sky_cells.h), and the ray-tracing pipeline, for which there is no kernel. */
static bool takes(const struct vulkan_backend *b, const void *parameters)
{
    const struct kiln_caustic_techniques *t = parameters;
    return t->images == NULL && (t->aims == NULL || t->aims->sky.count <= 1) && b->tracer.acceleration == NULL;
}

const struct vulkan_pass vulkan_pass_weighed = {
    .run = run,
    .takes = takes,
    .release = vulkan_techniques_release,
    .ahead = {{.shader = &chains_shader},
              {.shader = &weighed_shader, .own = SURFACES},
              {.shader = &weighed_shader, .draw_again = true, .own = SURFACES},
              {.shader = &chains_add_shader, .own = BEGINS},
              {.shader = &chains_add_shader, .own = ADDS_WEIGHED},
              {.shader = &sums_shader}}};
