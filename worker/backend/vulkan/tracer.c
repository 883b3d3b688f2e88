#include "worker/backend/vulkan/tracer.h"

#include <math.h>
#include <string.h>

#include "shaders/shared/random.h"
#include "worker/backend/vulkan/vulkan.h"
#include "worker/base/memory.h"
#include "worker/sampling/sequence.h"
#include "worker/scene/footprint.h"

enum { MOST_CANDIDATES = 2, TRIAL_RAYS = 1 << 20, MOST_TRIALS = 64 };
static const double TRIAL_SECONDS = 0.05, PIPELINE_MARGIN = 1.25;
/* Rays per triangle up to which a tree built on the device saves time. In the city, with 4 million triangles, it saves
 * an H200 with 16 cores 1.4 s, and its rays take 6.5 % longer, 2e-11 s each. */
static const double MOST_RAYS = 16000.0;
static const double FEW_RAYS = 5e8; /* a tenth of a second of one H200 */

/* BVH for compute traversal: the one built on the device, that built on the host, or both. */
struct trees {
    struct bvh_device *device;
    struct bvh *host;
};

const char *vulkan_tracer_name(const struct vulkan_tracer *tracer)
{
    static const char *const names[][2] = {
        [VULKAN_TREE_OF_HOST] = {"four-wide BVH", "compressed eight-wide BVH"},
        [VULKAN_TREE_OF_DEVICE] = {"four-wide BVH built there", "compressed eight-wide BVH built there"},
        [VULKAN_TREE_FETCHED] = {"four-wide BVH built there, laid out here",
                                 "compressed eight-wide BVH built there, laid out here"}};
    return tracer->acceleration != NULL ? "ray-tracing pipeline" : names[tracer->tree][tracer->traversal & 1u];
}

void vulkan_tracer_destroy(struct gpu *gpu, struct vulkan_tracer *tracer)
{
    acceleration_destroy(&tracer->acceleration);
    gpu_buffer_destroy(gpu, &tracer->nodes);
    gpu_buffer_destroy(gpu, &tracer->triangles);
    *tracer = (struct vulkan_tracer){0};
}

static struct kiln_gpu_trace layout_of(const struct vulkan_backend *b, const struct vulkan_tracer *t,
                                       size_t triangle_count)
{
    return (struct kiln_gpu_trace){.nodes = t->nodes.address,
                                   .triangles = t->triangles.address,
                                   .triangle_count = (uint32_t)triangle_count,
                                   .extent = b->params.geometry->extent};
}

/* Gets the tree on the host; if missing, converts the device's, or builds one with Embree. */
static int have_host_tree(struct vulkan_backend *b, struct trees *trees, struct kiln_error *error)
{
    const struct bvh_params params = {.threads = b->params.threads};
    if (trees->host != NULL)
        return KILN_OK;
    return trees->device != NULL ? bvh_device_fetch(trees->device, &params, &trees->host, error)
                                 : bvh_create(&trees->host, b->params.geometry, &params, error);
}

static int make_on_host(struct vulkan_backend *b, struct trees *trees, struct vulkan_tracer *t,
                        struct kiln_error *error)
{
    struct bvh_layout layout = {0};
    int status;
    KILN_TRY(have_host_tree(b, trees, error));
    KILN_TRY(bvh_layout_create(&layout, trees->host, t->traversal, error));
    KILN_TRY(gpu_buffer_of(b->gpu, &t->nodes, layout.nodes, layout.node_count * layout.node_size, "the BVH", error));
    KILN_TRY(gpu_buffer_of(b->gpu, &t->triangles, layout.triangles, layout.triangle_count * sizeof *layout.triangles,
                           "the BVH's triangles", error));
end:
    t->layout = layout_of(b, t, layout.triangle_count);
    t->tree = bvh_is_of_device(trees->host) ? VULKAN_TREE_FETCHED : VULKAN_TREE_OF_HOST;
    bvh_layout_free(&layout);
    return status;
}

static int make_compute(struct vulkan_backend *b, struct trees *trees, uint32_t traversal, struct vulkan_tracer *t,
                        struct kiln_error *error)
{
    struct bvh_device_layout layout;
    bool too_deep = false;
    *t = (struct vulkan_tracer){.traversal = traversal, .tree = VULKAN_TREE_OF_DEVICE};
    if (trees->device == NULL || traversal != KILN_TRAVERSAL_FOUR)
        return make_on_host(b, trees, t, error);
    const int status = bvh_device_layout_create(trees->device, &layout, &too_deep, error);
    if (status == KILN_OK && too_deep)
        return make_on_host(b, trees, t, error);
    t->nodes = layout.nodes;
    t->triangles = layout.triangles;
    t->layout = layout_of(b, t, layout.triangle_count);
    return status;
}

static int make_pipeline(struct vulkan_backend *b, struct vulkan_tracer *t, struct kiln_error *error)
{
    *t = (struct vulkan_tracer){.traversal = KILN_TRAVERSAL_PIPELINE};
    if (!gpu_about(b->gpu)->ray_tracing)
        return kiln_fail(error, KILN_NO_DEVICE, "%s offers no ray-tracing pipeline; do not set KILN_TRAVERSAL=pipeline",
                         gpu_about(b->gpu)->name);
    const int status = acceleration_create(&t->acceleration, b->gpu, b->params.geometry, error);
    t->layout = (struct kiln_gpu_trace){.top_level = status == KILN_OK ? acceleration_address(t->acceleration) : 0,
                                        .extent = b->params.geometry->extent};
    return status;
}

static int make(struct vulkan_backend *b, struct trees *trees, uint32_t traversal, struct vulkan_tracer *t,
                struct kiln_error *error)
{
    return traversal == KILN_TRAVERSAL_PIPELINE ? make_pipeline(b, t, error)
                                                : make_compute(b, trees, traversal, t, error);
}

/* Makes all later kernels use the tracer. */
static int use(struct vulkan_backend *b, const struct vulkan_tracer *t, struct kiln_error *error)
{
    vulkan_forget_kernels(b);
    b->tracer = *t;
    b->layout.trace = t->layout;
    b->constants[VULKAN_TRAVERSAL] = t->traversal;
    return vulkan_upload_root(b, error);
}

void vulkan_tracer_rays(const struct kiln_geometry *g, uint32_t count, uint32_t threads, struct kiln_vec3 *origins,
                        struct kiln_vec3 *directions)
{
#pragma omp parallel for schedule(static) num_threads((int)threads)
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t triangle = (uint32_t)((uint64_t)i * g->triangle_count / count), key = kiln_hash1(i);
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

/* Measures the rays per second of the tracer in use. */
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

/* Measures the candidates one after the other, and leaves the fastest in use. */
static int try_all(struct vulkan_backend *b, struct trees *trees, const uint32_t *candidates, size_t count,
                   struct kiln_error *error)
{
    struct kiln_vec3 *host = NULL;
    struct gpu_buffer rays = {0}, hits = {0};
    struct vulkan_tracer best = {0};
    int status = kiln_allocate(&host, 2 * TRIAL_RAYS, sizeof *host, "rays to try", error);
    if (status == KILN_OK) {
        vulkan_tracer_rays(b->params.geometry, TRIAL_RAYS, b->threads, host, host + TRIAL_RAYS);
        status = gpu_buffer_of(b->gpu, &rays, host, 2 * TRIAL_RAYS * sizeof *host, "rays to try", error);
    }
    if (status == KILN_OK)
        status = gpu_buffer_create(b->gpu, &hits, TRIAL_RAYS * sizeof(struct kiln_gpu_hit), GPU_DEVICE,
                                   "hits of rays to try", error);
    for (size_t i = 0; i < count && status == KILN_OK; i++) {
        struct vulkan_tracer t;
        status = make(b, trees, candidates[i], &t, error);
        if (status == KILN_OK)
            status = use(b, &t, error);
        if (status == KILN_OK)
            status = try_rays(b, &rays, &hits, &t.rate, error);
        const bool better = status == KILN_OK && t.rate > best.rate * PIPELINE_MARGIN;
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

/* Lists the traversals to be measured, the pipeline last. On an H200 four-wide traversal was the fastest from 46
 * triangles to 4 million (compressed eight-wide was 10 to 55 % slower). On Mesa's software device eight-wide was twice
 * as fast, and has the shortest loops. */
static size_t list_candidates(const struct vulkan_backend *b, uint32_t candidates[MOST_CANDIDATES])
{
    static const uint32_t one[] = {[KILN_TRAVERSE_PIPELINE] = KILN_TRAVERSAL_PIPELINE,
                                   [KILN_TRAVERSE_FOUR] = KILN_TRAVERSAL_FOUR,
                                   [KILN_TRAVERSE_EIGHT] = KILN_TRAVERSAL_EIGHT};
    const enum kiln_traversal wish = b->params.traversal;
    const struct kiln_device *about = gpu_about(b->gpu);
    const bool any = wish == KILN_TRAVERSE_AUTO || wish == KILN_TRAVERSE_COMPUTE;
    candidates[0] = !any ? one[wish] : about->software ? KILN_TRAVERSAL_EIGHT : KILN_TRAVERSAL_FOUR;
    candidates[1] = KILN_TRAVERSAL_PIPELINE;
    const bool tries = wish == KILN_TRAVERSE_AUTO && about->ray_tracing && !about->software &&
                       !has_few_rays(&b->params) && kiln_geometry_hittable_count(b->params.geometry) > 0 &&
                       acceleration_can(b->params.geometry);
    return tries ? 2 : 1;
}

/* Whether the device builds the tree: if that is faster including all expected rays, which are slightly faster in
 * Embree's tree, and the bake needs a tree for compute traversal. */
static bool device_builds(const struct vulkan_backend *b)
{
    const struct kiln_geometry *g = b->params.geometry;
    const double triangles = (double)kiln_geometry_hittable_count(g);
    const enum kiln_tree_builder wish = b->faults.wanted.tree;
    if (wish == KILN_TREE_HOST || !bvh_device_can(b->gpu, g))
        return false;
    return wish == KILN_TREE_DEVICE ||
           (!gpu_about(b->gpu)->software && triangles >= BVH_DEVICE_LEAST && b->params.rays <= MOST_RAYS * triangles);
}

/* Builds one tree: on the device, if all traversals to be measured can use it. */
static int build_tree(struct vulkan_backend *b, struct trees *trees, struct kiln_error *error)
{
    bool fits = true;
    if (!device_builds(b))
        return have_host_tree(b, trees, error);
    int status = bvh_device_create(&trees->device, b->gpu, b->params.geometry, b->params.threads, error);
    if (status == KILN_OK)
        status = bvh_device_fits(trees->device, &fits, error);
    if (status != KILN_OK || fits)
        return status;
    status = have_host_tree(b, trees, error);
    bvh_device_destroy(&trees->device);
    return status;
}

int vulkan_tracer_create(struct vulkan_backend *b, struct kiln_error *error)
{
    struct trees trees = {NULL, NULL};
    uint32_t candidates[MOST_CANDIDATES];
    int status = b->params.traversal != KILN_TRAVERSE_PIPELINE ? build_tree(b, &trees, error) : KILN_OK;
    if (status == KILN_OK) {
        const size_t count = list_candidates(b, candidates);
        struct vulkan_tracer t;
        if (count > 1)
            status = try_all(b, &trees, candidates, count, error);
        else if ((status = make(b, &trees, candidates[0], &t, error)) == KILN_OK)
            status = use(b, &t, error);
        else
            vulkan_tracer_destroy(b->gpu, &t);
    }
    bvh_device_destroy(&trees.device);
    bvh_destroy(&trees.host);
    return status;
}
