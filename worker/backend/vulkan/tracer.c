#include "worker/backend/vulkan/tracer.h"

#include <math.h>
#include <string.h>

#include "shaders/shared/random.h"
#include "worker/backend/vulkan/vulkan.h"
#include "worker/base/memory.h"
#include "worker/sampling/sequence.h"
#include "worker/scene/footprint.h"

enum { MOST_CANDIDATES = 8, TRIAL_RAYS = 1 << 20, MOST_TRIALS = 64 };
static const double TRIAL_SECONDS = 0.05, LAYOUT_MARGIN = 1.1, PIPELINE_MARGIN = 1.25;
static const double FEW_RAYS = 5e8; /* a tenth of a second of one H200 */

const char *vulkan_tracer_name(const struct vulkan_tracer *tracer)
{
    static const char *const names[] = {"all triangles tested", "binary BVH", "four-wide BVH",
                                        "compressed eight-wide BVH"};
    return tracer->acceleration != NULL ? "ray-tracing pipeline" : names[tracer->traversal & 3u];
}

void vulkan_tracer_destroy(struct gpu *gpu, struct vulkan_tracer *tracer)
{
    acceleration_destroy(&tracer->acceleration);
    gpu_buffer_destroy(gpu, &tracer->nodes);
    gpu_buffer_destroy(gpu, &tracer->triangles);
    *tracer = (struct vulkan_tracer){0};
}

static int make_compute(struct vulkan_backend *b, const struct bvh *bvh, uint32_t traversal, struct vulkan_tracer *t,
                        struct kiln_error *error)
{
    struct bvh_layout layout = {0};
    *t = (struct vulkan_tracer){.traversal = traversal};
    int status = bvh_layout_create(&layout, bvh, traversal, error);
    if (status == KILN_OK)
        status = gpu_buffer_of(b->gpu, &t->nodes, layout.nodes, layout.node_count * layout.node_size, "the BVH", error);
    if (status == KILN_OK)
        status = gpu_buffer_of(b->gpu, &t->triangles, layout.triangles,
                               layout.triangle_count * sizeof *layout.triangles, "the BVH's triangles", error);
    t->layout = (struct kiln_gpu_trace){.nodes = t->nodes.address,
                                        .triangles = t->triangles.address,
                                        .triangle_count = (uint32_t)layout.triangle_count,
                                        .extent = b->params.geometry->extent};
    bvh_layout_free(&layout);
    return status;
}

static int make_pipeline(struct vulkan_backend *b, struct vulkan_tracer *t, struct kiln_error *error)
{
    *t = (struct vulkan_tracer){.traversal = KILN_TRAVERSAL_PIPELINE};
    if (!gpu_about(b->gpu)->ray_tracing)
        return kiln_fail(error, KILN_NO_DEVICE, "%s offers no ray-tracing pipeline; use --traversal compute",
                         gpu_about(b->gpu)->name);
    const int status = acceleration_create(&t->acceleration, b->gpu, b->params.geometry, error);
    t->layout = (struct kiln_gpu_trace){.top_level = status == KILN_OK ? acceleration_address(t->acceleration) : 0,
                                        .extent = b->params.geometry->extent};
    return status;
}

static int make(struct vulkan_backend *b, const struct bvh *bvh, uint32_t traversal, struct vulkan_tracer *t,
                struct kiln_error *error)
{
    return traversal == KILN_TRAVERSAL_PIPELINE ? make_pipeline(b, t, error)
                                                : make_compute(b, bvh, traversal, t, error);
}

/* Makes all kernels to come use the tracer. */
static int use(struct vulkan_backend *b, const struct vulkan_tracer *t, struct kiln_error *error)
{
    vulkan_forget_kernels(b);
    b->tracer = *t;
    b->layout.trace = t->layout;
    b->constants[VULKAN_TRAVERSAL] = t->traversal;
    return vulkan_upload_root(b, error);
}

/* Diffuse rays from triangles in their stored order: as a bounce makes them, about. */
static void make_rays(const struct vulkan_backend *b, struct kiln_vec3 *origins, struct kiln_vec3 *directions)
{
    const struct kiln_geometry *g = b->params.geometry;
#pragma omp parallel for schedule(static) num_threads((int)b->threads)
    for (uint32_t i = 0; i < TRIAL_RAYS; i++) {
        const uint32_t triangle = (uint32_t)((uint64_t)i * g->triangle_count / TRIAL_RAYS), key = kiln_hash1(i);
        const struct kiln_vec3 n = kiln_triangle_normal(g, triangle);
        const float s = sqrtf(kiln_unit_float(key)), t = kiln_unit_float(kiln_hash1(key + 1u));
        const struct kiln_dvec3 local =
            kiln_cosine_direction(kiln_unit_double(kiln_hash1(key + 2u)), kiln_unit_double(kiln_hash1(key + 3u)));
        struct kiln_vec3 x, y;
        kiln_basis(n, &x, &y);
        origins[i] = kiln_offset_origin(kiln_triangle_position(g, triangle, s * (1.0f - t), s * t), n, g, triangle);
        directions[i] = vec3_madd(vec3_madd(vec3_scale(x, (float)local.x), y, (float)local.y), n, (float)local.z);
    }
}

/* Rays per second of the tracer in use. */
static int try_rays(struct vulkan_backend *b, const struct gpu_buffer *rays, const struct gpu_buffer *hits,
                    double *rate, struct kiln_error *error)
{
    double total = 0.0, best = INFINITY;
    int status = KILN_OK;
    for (int i = 0; i < MOST_TRIALS && status == KILN_OK && (i < 2 || total < TRIAL_SECONDS); i++) {
        double seconds = 0.0;
        status = vulkan_intersect_on_device(b, rays->address, rays->address + TRIAL_RAYS * sizeof(struct kiln_vec3),
                                            hits->address, TRIAL_RAYS, &seconds, error);
        total += seconds;
        best = fmin(best, seconds);
    }
    *rate = best > 0.0 ? TRIAL_RAYS / best : 0.0;
    return status;
}

/* Tries the candidates in turn and leaves the best in use. */
static int try_all(struct vulkan_backend *b, const struct bvh *bvh, const uint32_t *candidates, size_t count,
                   struct kiln_error *error)
{
    struct kiln_vec3 *host = NULL;
    struct gpu_buffer rays = {0}, hits = {0};
    struct vulkan_tracer best = {0};
    int status = kiln_allocate(&host, 2 * TRIAL_RAYS, sizeof *host, "rays to try", error);
    if (status == KILN_OK) {
        make_rays(b, host, host + TRIAL_RAYS);
        status = gpu_buffer_of(b->gpu, &rays, host, 2 * TRIAL_RAYS * sizeof *host, "rays to try", error);
    }
    if (status == KILN_OK)
        status = gpu_buffer_create(b->gpu, &hits, TRIAL_RAYS * sizeof(struct kiln_gpu_hit), GPU_DEVICE,
                                   "hits of rays to try", error);
    for (size_t i = 0; i < count && status == KILN_OK; i++) {
        struct vulkan_tracer t;
        status = make(b, bvh, candidates[i], &t, error);
        if (status == KILN_OK)
            status = use(b, &t, error);
        if (status == KILN_OK)
            status = try_rays(b, &rays, &hits, &t.rate, error);
        const bool better =
            status == KILN_OK && t.rate > best.rate * (t.acceleration != NULL ? PIPELINE_MARGIN : LAYOUT_MARGIN);
        b->tracer = (struct vulkan_tracer){0};
        vulkan_tracer_destroy(b->gpu, better ? &best : &t);
        best = better ? t : best;
    }
    if (status == KILN_OK)
        status = use(b, &best, error);
    else
        vulkan_tracer_destroy(b->gpu, &best);
    gpu_buffer_destroy(b->gpu, &rays);
    gpu_buffer_destroy(b->gpu, &hits);
    kiln_free(&host);
    return status;
}

static bool has_few_rays(const struct kiln_backend_params *params)
{
    return params->rays > 0.0 && params->rays < FEW_RAYS;
}

bool vulkan_tracer_may_be_pipeline(const struct kiln_backend_params *params)
{
    return params->traversal == KILN_TRAVERSE_PIPELINE ||
           (params->traversal == KILN_TRAVERSE_AUTO && !has_few_rays(params));
}

/* What may be tried, the pipeline last. */
static size_t list_candidates(const struct vulkan_backend *b, const struct bvh *bvh, uint32_t *candidates)
{
    static const uint32_t one[] = {[KILN_TRAVERSE_PIPELINE] = KILN_TRAVERSAL_PIPELINE,
                                   [KILN_TRAVERSE_ALL] = KILN_TRAVERSAL_BRUTE,
                                   [KILN_TRAVERSE_BINARY] = KILN_TRAVERSAL_BINARY,
                                   [KILN_TRAVERSE_FOUR] = KILN_TRAVERSAL_FOUR,
                                   [KILN_TRAVERSE_EIGHT] = KILN_TRAVERSAL_EIGHT};
    const enum kiln_traversal wish = b->params.traversal;
    const struct kiln_device *about = gpu_about(b->gpu);
    if (wish != KILN_TRAVERSE_AUTO && wish != KILN_TRAVERSE_COMPUTE) {
        candidates[0] = one[wish];
        return 1;
    }
    size_t count = bvh_candidates(bvh, about->software, candidates, MOST_CANDIDATES - 1);
    if (about->software || has_few_rays(&b->params) || kiln_geometry_hittable_count(b->params.geometry) == 0)
        return 1;
    if (wish == KILN_TRAVERSE_AUTO && about->ray_tracing)
        candidates[count++] = KILN_TRAVERSAL_PIPELINE;
    return count;
}

int vulkan_tracer_create(struct vulkan_backend *b, struct kiln_error *error)
{
    const struct bvh_params params = {.threads = b->params.threads};
    struct bvh *bvh = NULL;
    uint32_t candidates[MOST_CANDIDATES];
    int status =
        b->params.traversal != KILN_TRAVERSE_PIPELINE ? bvh_create(&bvh, b->params.geometry, &params, error) : KILN_OK;
    if (status == KILN_OK) {
        const size_t count = list_candidates(b, bvh, candidates);
        struct vulkan_tracer t;
        if (count > 1)
            status = try_all(b, bvh, candidates, count, error);
        else if ((status = make(b, bvh, candidates[0], &t, error)) == KILN_OK)
            status = use(b, &t, error);
        else
            vulkan_tracer_destroy(b->gpu, &t);
    }
    bvh_destroy(&bvh);
    return status;
}
