/* Trees of boxes for the device, side by side: Embree's (worker/backend/vulkan/bvh.h) and the device's own
 * (bvh_device.h).
 *
 *   KILN=build/release/kiln build/release/tests/bench_trees SCENE...
 *
 * Of each scene and each tree: seconds to build it and to lay it out in nodes of four; what the surface area heuristic
 * expects of that layout, and what diffuse rays from all triangles really meet, nodes and triangles a ray, counted by a
 * walk on the host as shaders/trace/four.glsl walks; millions of rays a second on the device, the best of several
 * times; and how many of the rays hit something else than with the other tree (there must be none). */
#include <float.h>
#include <math.h>
#include <omp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "coordinator/import/import.h"
#include "worker/backend/vulkan/bvh_device.h"
#include "worker/backend/vulkan/tracer.h"
#include "worker/backend/vulkan/vulkan.h"

enum { RAYS = 1 << 20, WALKED = 1 << 17, TIMES = 8 };

struct rays {
    struct kiln_vec3 origins[RAYS], directions[RAYS];
};

struct layout {
    struct kiln_gpu_bvh4_node *nodes;
    struct kiln_gpu_triangle *triangles;
    size_t node_count, triangle_count;
};

struct counts {
    double nodes, triangles;
};

static void check(int status, const struct kiln_error *error)
{
    if (status == KILN_OK)
        return;
    (void)fprintf(stderr, "%s\n", error->message);
    exit(1);
}

/* ---- what a layout costs ---- */

static double area_of(const struct kiln_gpu_bvh4_node *node, int i)
{
    const double x = (double)node->bounds[1][i] - (double)node->bounds[0][i],
                 y = (double)node->bounds[3][i] - (double)node->bounds[2][i],
                 z = (double)node->bounds[5][i] - (double)node->bounds[4][i];
    return x * y + y * z + z * x;
}

/* A node and a triangle cost the same. */
static double expected(const struct layout *l, const struct kiln_geometry *g)
{
    const struct kiln_vec3 size = vec3_sub(g->bounds_max, g->bounds_min);
    const double whole =
        (double)size.x * (double)size.y + (double)size.y * (double)size.z + (double)size.z * (double)size.x;
    double sum = whole;
    for (size_t n = 0; n < l->node_count; n++)
        for (int i = 0; i < 4; i++) {
            const uint32_t child = l->nodes[n].child[i];
            if (child != KILN_GPU_NONE)
                sum += area_of(&l->nodes[n], i) *
                       (child >= KILN_GPU_LEAF ? (child >> KILN_GPU_LEAF_COUNT_SHIFT & 3u) + 1u : 1u);
        }
    return sum / whole;
}

static void meet(const struct kiln_gpu_triangle *t, struct kiln_vec3 origin, struct kiln_vec3 direction,
                 float *distance)
{
    const struct kiln_vec3 a = vec3(t->a[0], t->a[1], t->a[2]), ab = vec3_sub(vec3(t->b[0], t->b[1], t->b[2]), a),
                           ac = vec3_sub(vec3(t->c[0], t->c[1], t->c[2]), a), p = vec3_cross(direction, ac),
                           s = vec3_sub(origin, a), q = vec3_cross(s, ab);
    const float determinant = vec3_dot(ab, p), u = vec3_dot(s, p) / determinant,
                v = vec3_dot(direction, q) / determinant, d = vec3_dot(ac, q) / determinant;
    if (u >= 0.0f && v >= 0.0f && u + v <= 1.0f && d > 0.0f && d < *distance)
        *distance = d;
}

static int near_first(float near[4], uint32_t child[4], int count)
{
    for (int i = 1; i < count; i++)
        for (int j = i; j > 0 && near[j] < near[j - 1]; j--) {
            const float n = near[j];
            const uint32_t c = child[j];
            near[j] = near[j - 1];
            child[j] = child[j - 1];
            near[j - 1] = n;
            child[j - 1] = c;
        }
    return count;
}

static int enter(const struct kiln_gpu_bvh4_node *node, struct kiln_vec3 origin, struct kiln_vec3 inverse,
                 float distance, uint32_t child[4])
{
    const float o[3] = {origin.x, origin.y, origin.z}, r[3] = {inverse.x, inverse.y, inverse.z};
    float near[4];
    int count = 0;
    for (int i = 0; i < 4; i++) {
        float in = 0.0f, out = distance;
        for (int k = 0; k < 3; k++) {
            const float a = (node->bounds[2 * k][i] - o[k]) * r[k], b = (node->bounds[2 * k + 1][i] - o[k]) * r[k];
            in = fmaxf(in, fminf(a, b));
            out = fminf(out, fmaxf(a, b));
        }
        if (in > out || node->child[i] == KILN_GPU_NONE)
            continue;
        near[count] = in;
        child[count++] = node->child[i];
    }
    return near_first(near, child, count);
}

static struct counts walk(const struct layout *l, struct kiln_vec3 origin, struct kiln_vec3 direction)
{
    uint32_t stack[KILN_GPU_STACK4], depth = 0;
    const struct kiln_vec3 inverse = vec3(1.0f / (fabsf(direction.x) < 1e-18f ? 1e-18f : direction.x),
                                          1.0f / (fabsf(direction.y) < 1e-18f ? 1e-18f : direction.y),
                                          1.0f / (fabsf(direction.z) < 1e-18f ? 1e-18f : direction.z));
    struct counts counts = {0.0, 0.0};
    float distance = FLT_MAX;
    stack[depth++] = 0;
    while (depth > 0) {
        const uint32_t at = stack[--depth];
        if (at >= KILN_GPU_LEAF) {
            const uint32_t first = at & KILN_GPU_LEAF_FIRST, count = (at >> KILN_GPU_LEAF_COUNT_SHIFT & 3u) + 1u;
            for (uint32_t i = first; i < first + count; i++)
                meet(&l->triangles[i], origin, direction, &distance);
            counts.triangles += count;
            continue;
        }
        uint32_t child[4];
        counts.nodes += 1.0;
        for (int i = enter(&l->nodes[at], origin, inverse, distance, child) - 1; i >= 0; i--)
            stack[depth++] = child[i];
    }
    return counts;
}

static struct counts walk_all(const struct layout *l, const struct rays *rays)
{
    double nodes = 0.0, triangles = 0.0;
#pragma omp parallel for schedule(dynamic, 1024) reduction(+ : nodes, triangles)
    for (int i = 0; i < WALKED; i++) {
        const int ray = i * (RAYS / WALKED);
        const struct counts c = walk(l, rays->origins[ray], rays->directions[ray]);
        nodes += c.nodes;
        triangles += c.triangles;
    }
    return (struct counts){nodes / WALKED, triangles / WALKED};
}

/* ---- on the device ---- */

static double trace(struct gpu *gpu, const struct kiln_geometry *g, const struct bvh_device_layout *l,
                    const struct rays *rays, struct kiln_gpu_hit *hits)
{
    const uint32_t constants[VULKAN_CONSTANTS] = {[VULKAN_TRAVERSAL] = KILN_TRAVERSAL_FOUR};
    const struct gpu_kernel_params params = {
        .name = "intersect", .code = &kiln_code_intersect, .constants = constants, .constant_count = VULKAN_CONSTANTS};
    const struct kiln_gpu_scene scene = {.trace = {.nodes = l->nodes.address,
                                                   .triangles = l->triangles.address,
                                                   .triangle_count = (uint32_t)l->triangle_count,
                                                   .extent = g->extent},
                                         .opaque_count = (uint32_t)g->triangle_count};
    struct gpu_buffer root, in, out;
    struct gpu_kernel *kernel = NULL;
    struct kiln_error error = {""};
    double best = INFINITY;
    check(gpu_kernel_create(gpu, &kernel, &params, &error), &error);
    check(gpu_buffer_of(gpu, &root, &scene, sizeof scene, "scene", &error), &error);
    check(gpu_buffer_of(gpu, &in, rays, sizeof *rays, "rays", &error), &error);
    check(gpu_buffer_create(gpu, &out, RAYS * sizeof *hits, GPU_DEVICE, "hits", &error), &error);
    const struct kiln_gpu_intersect_push push = {.scene = root.address,
                                                 .origins = in.address,
                                                 .directions = in.address + sizeof rays->origins,
                                                 .hits = out.address,
                                                 .count = RAYS};
    const struct gpu_step step = {
        .kernel = kernel, .threads_x = RAYS, .threads_y = 1, .constants = &push, .constant_bytes = sizeof push};
    for (int i = 0; i < (gpu_about(gpu)->software ? 1 : TIMES); i++) {
        double seconds = 0.0;
        check(gpu_run(gpu, &step, 1, &seconds, &error), &error);
        best = fmin(best, seconds);
    }
    check(gpu_download(gpu, &out, 0, hits, RAYS * sizeof *hits, &error), &error);
    gpu_buffer_destroy(gpu, &root);
    gpu_buffer_destroy(gpu, &in);
    gpu_buffer_destroy(gpu, &out);
    gpu_kernel_destroy(gpu, &kernel);
    return RAYS / best;
}

static void tell(struct gpu *gpu, const struct kiln_geometry *g, const char *tree, const double seconds[2],
                 struct bvh_device_layout *l, const struct rays *rays, struct kiln_gpu_hit *hits)
{
    struct kiln_error error = {""};
    struct layout here = {.node_count = l->node_count, .triangle_count = l->triangle_count};
    here.nodes = malloc(l->node_count * sizeof *here.nodes);
    here.triangles = malloc(l->triangle_count * sizeof *here.triangles);
    check(gpu_download(gpu, &l->nodes, 0, here.nodes, l->node_count * sizeof *here.nodes, &error), &error);
    check(gpu_download(gpu, &l->triangles, 0, here.triangles, l->triangle_count * sizeof *here.triangles, &error),
          &error);
    const struct counts counts = walk_all(&here, rays);
    printf("  %-8s build %8.4f s, layout %8.4f s; %8zu nodes, expected cost %7.2f, a ray %6.2f nodes %6.2f triangles, ",
           tree, seconds[0], seconds[1], l->node_count, expected(&here, g), counts.nodes, counts.triangles);
    printf("%8.2f Mrays/s\n", trace(gpu, g, l, rays, hits) * 1e-6);
    free(here.nodes);
    free(here.triangles);
    bvh_device_layout_free(l, gpu);
}

static void try_embree(struct gpu *gpu, const struct kiln_geometry *g, const struct rays *rays,
                       struct kiln_gpu_hit *hits)
{
    struct kiln_error error = {""};
    struct bvh *bvh = NULL;
    struct bvh_layout made;
    double seconds[2], start = kiln_clock_seconds();
    check(bvh_create(&bvh, g, &(struct bvh_params){0}, &error), &error);
    seconds[0] = kiln_clock_seconds() - start;
    start = kiln_clock_seconds();
    check(bvh_layout_create(&made, bvh, KILN_TRAVERSAL_FOUR, &error), &error);
    struct bvh_device_layout l = {.node_count = made.node_count, .triangle_count = made.triangle_count};
    check(gpu_buffer_of(gpu, &l.nodes, made.nodes, made.node_count * made.node_size, "nodes", &error), &error);
    check(gpu_buffer_of(gpu, &l.triangles, made.triangles, made.triangle_count * sizeof *made.triangles, "triangles",
                        &error),
          &error);
    seconds[1] = kiln_clock_seconds() - start;
    bvh_layout_free(&made);
    bvh_destroy(&bvh);
    tell(gpu, g, "Embree", seconds, &l, rays, hits);
}

static void try_device(struct gpu *gpu, const struct kiln_geometry *g, const struct rays *rays,
                       struct kiln_gpu_hit *hits)
{
    struct kiln_error error = {""};
    struct bvh_device *tree = NULL;
    struct bvh_device_layout l;
    bool too_deep = false;
    double seconds[2], start = kiln_clock_seconds();
    check(bvh_device_create(&tree, gpu, g, 0, &error), &error);
    seconds[0] = kiln_clock_seconds() - start;
    start = kiln_clock_seconds();
    check(bvh_device_layout_create(tree, &l, &too_deep, &error), &error);
    seconds[1] = kiln_clock_seconds() - start;
    bvh_device_destroy(&tree);
    if (too_deep)
        printf("  device   the tree is too deep: a stack of %u\n", l.stack);
    else
        tell(gpu, g, "device", seconds, &l, rays, hits);
}

static void try_scene(struct gpu *gpu, const char *path)
{
    char file[] = "/tmp/kiln_trees_XXXXXX";
    struct kiln_error error = {""};
    struct kiln_import_report report;
    struct kiln_scene *scene = NULL;
    struct kiln_geometry *g = NULL;
    const int descriptor = mkstemp(file);
    if (descriptor < 0 || close(descriptor) != 0)
        check(KILN_SYSTEM, &(struct kiln_error){"cannot make a file in /tmp"});
    const struct kiln_import_params params = {
        .path = path, .output = file, .environment_scale = 1.0, .no_layout = true, .program = getenv("KILN")};
    check(kiln_import(&params, &report, &error), &error);
    check(kiln_scene_open(&scene, file, &error), &error);
    (void)unlink(file);
    check(kiln_geometry_create(&g, scene, &error), &error);
    struct rays *rays = malloc(sizeof *rays);
    struct kiln_gpu_hit *hits = malloc(2 * RAYS * sizeof *hits);
    vulkan_tracer_rays(g, RAYS, (uint32_t)omp_get_max_threads(), rays->origins, rays->directions);
    printf("%s: %zu triangles\n", path, kiln_geometry_hittable_count(g));
    try_embree(gpu, g, rays, hits);
    try_device(gpu, g, rays, hits + RAYS);
    try_device(gpu, g, rays, hits + RAYS);
    size_t unlike = 0;
    for (size_t i = 0; i < RAYS; i++)
        unlike += memcmp(&hits[i], &hits[RAYS + i], sizeof *hits) != 0;
    printf("  %zu of %d rays hit something else\n", unlike, RAYS);
    free(rays);
    free(hits);
    kiln_geometry_destroy(&g);
    kiln_scene_close(&scene);
}

int main(int count, char **arguments)
{
    struct gpu *gpu = NULL;
    struct kiln_error error = {""};
    check(gpu_create(&gpu, &(struct gpu_choice){.device = -1, .threads = 16}, &error), &error);
    printf("%s\n", gpu_about(gpu)->name);
    for (int i = 1; i < count; i++)
        try_scene(gpu, arguments[i]);
    gpu_destroy(&gpu);
    return 0;
}
