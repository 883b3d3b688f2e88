/* Tests of the BVH on the device: every layout finds the hits of Embree, all layouts find the same hits, and no ray
 * slips through between triangles. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "tests/unit/vulkan_device.h"
#include "worker/backend/backend.h"
#include "worker/backend/vulkan/bvh_device.h"
#include "worker/backend/vulkan/vulkan.h"

enum { RAYS = 8192, LAYOUTS = 2 };
static const uint32_t layouts[LAYOUTS] = {KILN_TRAVERSAL_FOUR, KILN_TRAVERSAL_EIGHT};

struct push {
    uint64_t scene, origins, directions, hits;
    uint32_t count;
};

/* ---- worlds ---- */

struct world {
    struct kiln_geometry g;
    struct kiln_vec3 origins[RAYS], directions[RAYS];
    uint64_t random;
};

static float chance(struct world *w)
{
    w->random = w->random * 6364136223846793005u + 1442695040888963407u;
    return (float)(w->random >> 40) * 0x1p-24f;
}

static struct world *world_create(size_t vertices, size_t triangles)
{
    struct world *w = calloc(1, sizeof *w);
    w->g.vertices = calloc(3 * vertices + 4, sizeof(float));
    w->g.indices = calloc(3 * triangles + 1, sizeof(uint32_t));
    w->random = 7;
    return w;
}

static void world_destroy(struct world *w)
{
    free(w->g.vertices);
    free(w->g.indices);
    free(w);
}

static uint32_t add_vertex(struct world *w, float x, float y, float z)
{
    float *p = w->g.vertices + 3 * w->g.vertex_count;
    p[0] = x;
    p[1] = y;
    p[2] = z;
    w->g.extent = fmaxf(w->g.extent, fmaxf(fabsf(x), fmaxf(fabsf(y), fabsf(z))));
    return (uint32_t)w->g.vertex_count++;
}

static void add_triangle(struct world *w, uint32_t a, uint32_t b, uint32_t c)
{
    uint32_t *t = w->g.indices + 3 * w->g.triangle_count++;
    t[0] = a;
    t[1] = b;
    t[2] = c;
    w->g.opaque_count = w->g.triangle_count;
}

static void world_finish(struct world *w)
{
    const float e = w->g.extent;
    w->g.bounds_min = vec3(-e, -e, -e);
    w->g.bounds_max = vec3(e, e, e);
}

/* A closed ball of n x 2n quads, uneven by `bumps`; poles are single vertices. */
static void add_ball(struct world *w, struct kiln_vec3 centre, float radius, uint32_t n, float bumps)
{
    const uint32_t first = (uint32_t)w->g.vertex_count, around = 2 * n;
    for (uint32_t i = 1; i < n; i++)
        for (uint32_t j = 0; j < around; j++) {
            const float a = (float)KILN_PI * (float)i / (float)n, b = (float)KILN_PI * (float)j / (float)n,
                        r = radius * (1.0f + bumps * (chance(w) - 0.5f));
            add_vertex(w, centre.x + r * sinf(a) * cosf(b), centre.y + r * sinf(a) * sinf(b), centre.z + r * cosf(a));
        }
    const uint32_t top = add_vertex(w, centre.x, centre.y, centre.z + radius),
                   bottom = add_vertex(w, centre.x, centre.y, centre.z - radius);
    for (uint32_t j = 0; j < around; j++) {
        const uint32_t k = (j + 1) % around;
        add_triangle(w, top, first + j, first + k);
        for (uint32_t i = 0; i + 2 < n; i++) {
            const uint32_t p = first + i * around;
            add_triangle(w, p + j, p + around + j, p + around + k);
            add_triangle(w, p + j, p + around + k, p + k);
        }
        add_triangle(w, bottom, first + (n - 2) * around + k, first + (n - 2) * around + j);
    }
}

static void add_box(struct world *w, float half)
{
    static const uint8_t side[6][4] = {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4},
                                       {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}};
    const uint32_t first = (uint32_t)w->g.vertex_count;
    for (uint32_t i = 0; i < 8; i++)
        add_vertex(w, i & 1 ? half : -half, i & 2 ? half : -half, i & 4 ? half : -half);
    for (int i = 0; i < 6; i++) {
        add_triangle(w, first + side[i][0], first + side[i][1], first + side[i][2]);
        add_triangle(w, first + side[i][0], first + side[i][2], first + side[i][3]);
    }
}

static void add_soup(struct world *w, size_t count, float half, float size, float narrow)
{
    for (size_t i = 0; i < count; i++) {
        const float x = half * (2.0f * chance(w) - 1.0f), y = half * (2.0f * chance(w) - 1.0f),
                    z = half * (2.0f * chance(w) - 1.0f);
        const uint32_t a = add_vertex(w, x, y, z);
        add_vertex(w, x + size * (chance(w) - 0.5f), y + size * (chance(w) - 0.5f), z + size * (chance(w) - 0.5f));
        add_vertex(w, x + narrow * (chance(w) - 0.5f), y + narrow * (chance(w) - 0.5f),
                   z + narrow * (chance(w) - 0.5f));
        add_triangle(w, a, a + 1, a + 2);
    }
}

static struct kiln_vec3 any_direction(struct world *w)
{
    const float z = 2.0f * chance(w) - 1.0f, a = 2.0f * (float)KILN_PI * chance(w),
                r = sqrtf(fmaxf(0.0f, 1.0f - z * z));
    return vec3(r * cosf(a), r * sinf(a), z);
}

/* Rays between random points of the world, some along the axes. */
static void any_rays(struct world *w, float half)
{
    for (int i = 0; i < RAYS; i++) {
        w->origins[i] =
            vec3(half * (2.0f * chance(w) - 1.0f), half * (2.0f * chance(w) - 1.0f), half * (2.0f * chance(w) - 1.0f));
        w->directions[i] = any_direction(w);
        if (i % 64 == 0)
            w->directions[i] =
                i & 64 ? vec3(0.0f, i & 128 ? 1.0f : -1.0f, 0.0f) : vec3(i & 128 ? 1.0f : -1.0f, 0.0f, -0.0f);
    }
}

/* From one place towards corners, and towards places on edges, of all triangles in turn. */
static void rays_at_edges(struct world *w, float half)
{
    for (int i = 0; i < RAYS; i++) {
        struct kiln_vec3 c[3];
        kiln_geometry_corners(&w->g, (uint64_t)i * 7919u % w->g.triangle_count, c);
        const struct kiln_vec3 to =
            i % 3 == 0 ? c[0] : vec3_madd(c[0], vec3_sub(c[1], c[0]), i % 3 == 1 ? 0.5f : chance(w));
        w->origins[i] = i & 1 ? vec3(0.0f, 0.0f, 0.0f)
                              : vec3(half * (chance(w) - 0.5f), half * (chance(w) - 0.5f), half * (chance(w) - 0.5f));
        w->directions[i] = vec3_normalize(vec3_sub(to, w->origins[i]));
    }
}

/* ---- tracing ---- */

/* The device and its kernels, one for each layout and either use. A software device takes longer to compile a kernel
 * than to trace with it: each is made once, for all worlds. */
struct tracer {
    struct gpu *gpu;
    struct gpu_kernel *kernels[LAYOUTS][2];
};

static int tracer_open(void **state)
{
    struct tracer *t = calloc(1, sizeof *t);
    struct kiln_error error = {""};
    if (vulkan_device_open((void **)&t->gpu) != 0) {
        free(t);
        return -1;
    }
    *state = t;
    for (uint32_t i = 0; i < 2 * LAYOUTS; i++) {
        const uint32_t constants[VULKAN_CONSTANTS] = {[VULKAN_TRAVERSAL] = layouts[i / 2], [VULKAN_OWN] = i % 2};
        const struct gpu_kernel_params params = {.name = "intersect",
                                                 .code = &kiln_code_intersect,
                                                 .constants = constants,
                                                 .constant_count = VULKAN_CONSTANTS};
        if (gpu_kernel_create(t->gpu, &t->kernels[i / 2][i % 2], &params, &error) != KILN_OK) {
            print_error("%s\n", error.message);
            return -1;
        }
    }
    return 0;
}

static int tracer_close(void **state)
{
    struct tracer *t = *state;
    for (int i = 0; t != NULL && i < 2 * LAYOUTS; i++)
        gpu_kernel_destroy(t->gpu, &t->kernels[i / 2][i % 2]);
    if (t != NULL)
        gpu_destroy(&t->gpu);
    free(t);
    return 0;
}

/* The device runs rays through a layout that lies there. */
static void run_rays(const struct tracer *t, const struct world *w, const struct gpu_buffer *nodes,
                     const struct gpu_buffer *triangles, size_t triangle_count, int at, bool occlusion,
                     struct kiln_gpu_hit *hits)
{
    struct gpu *gpu = t->gpu;
    struct kiln_error error = {""};
    struct gpu_buffer b[4] = {{.size = 0}};
    const struct kiln_gpu_scene scene = {.trace = {.nodes = nodes->address,
                                                   .triangles = triangles->address,
                                                   .triangle_count = (uint32_t)triangle_count,
                                                   .extent = w->g.extent},
                                         .opaque_count = (uint32_t)w->g.opaque_count};
    assert_int_equal(gpu_buffer_of(gpu, &b[0], &scene, sizeof scene, "scene", &error), KILN_OK);
    assert_int_equal(gpu_buffer_of(gpu, &b[1], w->origins, sizeof w->origins, "origins", &error), KILN_OK);
    assert_int_equal(gpu_buffer_of(gpu, &b[2], w->directions, sizeof w->directions, "directions", &error), KILN_OK);
    assert_int_equal(gpu_buffer_of(gpu, &b[3], hits, RAYS * sizeof *hits, "hits", &error), KILN_OK);
    const struct push push = {b[0].address, b[1].address, b[2].address, b[3].address, RAYS};
    const struct gpu_step step = {.kernel = t->kernels[at][occlusion],
                                  .threads_x = RAYS,
                                  .threads_y = 1,
                                  .constants = &push,
                                  .constant_bytes = sizeof push};
    double seconds = 0.0;
    assert_int_equal(gpu_run(gpu, &step, 1, &seconds, &error), KILN_OK);
    assert_int_equal(gpu_download(gpu, &b[3], 0, hits, RAYS * sizeof *hits, &error), KILN_OK);
    print_message("traversal %2u%s: %6.2f Mrays/s\n", layouts[at], occlusion ? " occlusion" : "",
                  RAYS / seconds * 1e-6);
    for (int i = 0; i < 4; i++)
        gpu_buffer_destroy(gpu, &b[i]);
}

static void trace(const struct tracer *t, const struct world *w, const struct bvh *bvh, int at, bool occlusion,
                  struct kiln_gpu_hit *hits)
{
    struct gpu *gpu = t->gpu;
    struct bvh_layout layout;
    struct kiln_error error = {""};
    if (bvh_layout_create(&layout, bvh, layouts[at], &error) != KILN_OK)
        fail_msg("%s", error.message);
    struct gpu_buffer b[2] = {{.size = 0}};
    assert_int_equal(gpu_buffer_of(gpu, &b[0], layout.nodes, layout.node_count * layout.node_size, "nodes", &error),
                     KILN_OK);
    assert_int_equal(gpu_buffer_of(gpu, &b[1], layout.triangles, layout.triangle_count * sizeof *layout.triangles,
                                   "triangles", &error),
                     KILN_OK);
    run_rays(t, w, &b[0], &b[1], layout.triangle_count, at, occlusion, hits);
    for (int i = 0; i < 2; i++)
        gpu_buffer_destroy(gpu, &b[i]);
    bvh_layout_free(&layout);
}

/* Layouts of the tree that the device builds, laid out there and here, all find `first`. */
static void check_device_tree(const struct tracer *t, const struct world *w, uint32_t depth_limit,
                              const struct kiln_gpu_hit *first)
{
    static struct kiln_gpu_hit hits[RAYS];
    struct kiln_error error = {""};
    struct bvh_device *tree = NULL;
    struct bvh *bvh = NULL;
    assert_true(bvh_device_can(t->gpu, &w->g));
    if (bvh_device_create(&tree, t->gpu, &w->g, 0, &error) != KILN_OK)
        fail_msg("%s", error.message);
    struct bvh_device_layout layout;
    bool too_deep = true;
    assert_int_equal(bvh_device_layout_create(tree, &layout, &too_deep, &error), KILN_OK);
    assert_false(too_deep);
    assert_int_equal(layout.triangle_count, w->g.triangle_count);
    run_rays(t, w, &layout.nodes, &layout.triangles, layout.triangle_count, 0, false, hits);
    assert_memory_equal(hits, first, sizeof hits);
    bvh_device_layout_free(&layout, t->gpu);
    assert_int_equal(bvh_device_fetch(tree, &(struct bvh_params){.depth_limit = depth_limit}, &bvh, &error), KILN_OK);
    for (int i = 0; i < LAYOUTS; i++) {
        trace(t, w, bvh, i, false, hits);
        assert_memory_equal(hits, first, sizeof hits);
    }
    bvh_destroy(&bvh);
    bvh_device_destroy(&tree);
}

static void trace_embree(const struct world *w, struct kiln_hit *hits)
{
    struct kiln_backend *embree = NULL;
    struct kiln_error error = {""};
    const struct kiln_ray_hints hints = {.alike = false};
    assert_int_equal(kiln_backend_embree.create(&embree, &(struct kiln_backend_params){.geometry = &w->g}, &error),
                     KILN_OK);
    assert_int_equal(kiln_backend_embree.intersect(embree, w->origins, w->directions, RAYS, &hints, hits, &error),
                     KILN_OK);
    kiln_backend_embree.destroy(&embree);
}

/* Counts rays that hit neither the same triangle as Embree's nor one at the same distance. */
static size_t unlike_embree(const struct kiln_gpu_hit *ours, const struct kiln_hit *theirs, float extent)
{
    size_t count = 0;
    for (int i = 0; i < RAYS; i++) {
        const bool near = fabsf(ours[i].distance - theirs[i].distance) <= 1e-5f * theirs[i].distance + 1e-6f * extent;
        count += ours[i].triangle != theirs[i].triangle &&
                 (theirs[i].triangle == KILN_NONE || ours[i].triangle == KILN_GPU_NONE || !near);
        if (ours[i].triangle == theirs[i].triangle && ours[i].triangle != KILN_GPU_NONE)
            count += ours[i].back != theirs[i].back;
    }
    return count;
}

/* Limits just before and just behind what is met. */
static void check_occlusion(const struct tracer *t, const struct world *w, const struct bvh *bvh, int at,
                            const struct kiln_gpu_hit *hits)
{
    static struct kiln_gpu_hit limits[RAYS];
    size_t wrong = 0;
    for (int i = 0; i < RAYS; i++)
        limits[i].distance = hits[i].triangle == KILN_GPU_NONE ? INFINITY : hits[i].distance * (i & 1 ? 0.999f : 1.0f);
    trace(t, w, bvh, at, true, limits);
    for (int i = 0; i < RAYS; i++)
        wrong += (limits[i].triangle == 0) != (hits[i].triangle != KILN_GPU_NONE && (i & 1) == 0);
    assert_int_equal(wrong, 0);
}

/* All layouts against the first, bit by bit, and against Embree but for `allowed` rays. */
static void check_world(const struct tracer *t, struct world *w, size_t allowed, bool closed, uint32_t depth_limit)
{
    static struct kiln_gpu_hit first[RAYS], hits[RAYS];
    static struct kiln_hit embree[RAYS];
    struct kiln_error error = {""};
    struct bvh *bvh = NULL;
    world_finish(w);
    if (bvh_create(&bvh, &w->g, &(struct bvh_params){.depth_limit = depth_limit}, &error) != KILN_OK)
        fail_msg("%s", error.message);
    print_message("%zu triangles\n", w->g.triangle_count);
    for (int i = 0; i < LAYOUTS; i++) {
        struct kiln_gpu_hit *to = i == 0 ? first : hits;
        trace(t, w, bvh, i, false, to);
        if (to == hits)
            assert_memory_equal(hits, first, sizeof hits);
        check_occlusion(t, w, bvh, i, first);
    }
    trace_embree(w, embree);
    const size_t unlike = unlike_embree(first, embree, w->g.extent);
    print_message("%zu of %d rays unlike Embree's\n", unlike, RAYS);
    assert_true(unlike <= allowed);
    for (int i = 0; i < RAYS && closed; i++)
        if (first[i].triangle == KILN_GPU_NONE)
            fail_msg("ray %d slipped out", i);
    bvh_destroy(&bvh);
    check_device_tree(t, w, depth_limit, first);
    world_destroy(w);
}

/* The layout of a world with as many threads, and with a tree as deep. */
static struct bvh_layout layout_by(const struct world *w, uint32_t traversal, uint32_t threads, uint32_t depth_limit)
{
    struct bvh_layout layout;
    struct bvh *bvh = NULL;
    assert_int_equal(bvh_create(&bvh, &w->g, &(struct bvh_params){threads, depth_limit}, NULL), KILN_OK);
    assert_int_equal(bvh_layout_create(&layout, bvh, traversal, NULL), KILN_OK);
    bvh_destroy(&bvh);
    return layout;
}

/* Several threads lay down the same nodes and triangles in the same places as one, also where subtrees are too deep. */
static void threads_do_not_matter(void **state)
{
    (void)state;
    enum { TRIANGLES = 20000 };
    struct world *w = world_create(3 * TRIANGLES, TRIANGLES);
    add_soup(w, TRIANGLES, 1.0f, 0.05f, 0.05f);
    world_finish(w);
    for (uint32_t i = 0; i < 2 * LAYOUTS; i++) {
        const uint32_t depth_limit = i < LAYOUTS ? 0 : 10;
        struct bvh_layout one = layout_by(w, layouts[i % LAYOUTS], 1, depth_limit),
                          several = layout_by(w, layouts[i % LAYOUTS], 3, depth_limit);
        assert_int_equal(one.node_count, several.node_count);
        assert_int_equal(one.triangle_count, TRIANGLES);
        assert_int_equal(several.triangle_count, TRIANGLES);
        assert_int_equal(one.stack, several.stack);
        assert_true(one.node_count == 0 || memcmp(one.nodes, several.nodes, one.node_count * one.node_size) == 0);
        assert_memory_equal(one.triangles, several.triangles, TRIANGLES * sizeof *one.triangles);
        bvh_layout_free(&one);
        bvh_layout_free(&several);
    }
    world_destroy(w);
}

static void box_room(void **state)
{
    struct world *w = world_create(16, 24);
    add_box(w, 1.0f);
    add_box(w, 0.3f);
    any_rays(w, 0.99f);
    check_world(*state, w, 0, true, 0);
}

static void balls_in_a_room(void **state)
{
    struct world *w = world_create(120000, 220000);
    add_box(w, 1.0f);
    for (int i = 0; i < 8; i++)
        add_ball(w, vec3(i & 1 ? 0.5f : -0.5f, i & 2 ? 0.5f : -0.5f, i & 4 ? 0.5f : -0.5f), 0.4f, 80, 0.01f);
    any_rays(w, 0.98f);
    check_world(*state, w, 4, true, 0);
}

static void edges_and_corners(void **state)
{
    static const float scales[] = {1e-6f, 1.0f, 1e6f};
    for (size_t i = 0; i < 3; i++) {
        struct world *w = world_create(20000, 20000);
        add_ball(w, vec3(0.1f * scales[i], 0.0f, 0.0f), scales[i], 40, 0.3f);
        rays_at_edges(w, 0.3f * scales[i]);
        check_world(*state, w, RAYS, true, 0);
    }
}

static void soup_and_needles(void **state)
{
    struct world *w = world_create(30000, 10000);
    add_soup(w, 6000, 1.0f, 0.1f, 0.1f);
    add_soup(w, 4000, 1.0f, 1.5f, 1e-4f);
    any_rays(w, 1.5f);
    check_world(*state, w, 16, false, 0);
}

static void poor_triangles(void **state)
{
    struct world *w = world_create(3000, 4000);
    add_soup(w, 200, 1.0f, 0.5f, 0.5f);
    for (uint32_t i = 0; i < 200; i++) {
        add_triangle(w, 3 * i, 3 * i, 3 * i + 1);         /* a line */
        add_triangle(w, 3 * i + 2, 3 * i + 2, 3 * i + 2); /* a point */
        for (uint32_t j = 0; j < 5; j++)
            add_triangle(w, 3 * i, 3 * i + 1, 3 * i + 2); /* the same again */
    }
    any_rays(w, 1.0f);
    check_world(*state, w, 16, false, 0);
}

static void hardly_any(void **state)
{
    for (size_t count = 0; count < 5; count++) {
        struct world *w = world_create(16, 8);
        add_soup(w, count, 0.3f, 2.0f, 2.0f);
        any_rays(w, 1.0f);
        if (count > 0) {
            check_world(*state, w, 0, false, 0);
            continue;
        }
        struct bvh *bvh = NULL;
        static struct kiln_gpu_hit hits[RAYS];
        const struct tracer *t = *state;
        assert_false(bvh_device_can(t->gpu, &w->g));
        assert_int_equal(bvh_create(&bvh, &w->g, &(struct bvh_params){0}, NULL), KILN_OK);
        for (int i = 0; i < LAYOUTS; i++) {
            trace(*state, w, bvh, i, false, hits);
            for (int j = 0; j < RAYS; j++)
                assert_int_equal(hits[j].triangle, KILN_GPU_NONE);
        }
        bvh_destroy(&bvh);
        world_destroy(w);
    }
}

/* Below the depth limit the tree is cut evenly: other boxes, the same hits. */
static void too_deep(void **state)
{
    struct world *w = world_create(12000, 4000);
    add_soup(w, 3000, 1.0f, 0.2f, 0.2f);
    any_rays(w, 1.0f);
    check_world(*state, w, 16, false, 4);
}

/* The tree of `chain`: at each level four triangles in large boxes beside a small one with all the rest. */
static void chain_nodes(struct kiln_gpu_bvh_node *nodes, struct kiln_gpu_bvh_subtree *shares, uint32_t triangles)
{
    uint32_t at = triangles, rest = KILN_GPU_NONE;
    for (uint32_t i = 0; i < triangles; i++) {
        nodes[i] = (struct kiln_gpu_bvh_node){{-2.0f, -2.0f, -2.0f}, i, {2.0f, 2.0f, 2.0f}, KILN_GPU_NONE};
        shares[i].triangles = KILN_GPU_LEAF | 1u;
    }
    for (uint32_t i = 0; i < triangles; i += 4) {
        const uint32_t inner[4][3] = {{i, i + 1, 2}, {i + 2, i + 3, 2}, {at, at + 1, 4}, {rest, at + 2, i + 4}};
        for (uint32_t k = 0; k < (i == 0 ? 3u : 4u); k++, at++) {
            const float size = k == 3 ? 0.1f : 2.0f;
            nodes[at] = (struct kiln_gpu_bvh_node){{-size, -size, -size}, inner[k][0], {size, size, size}, inner[k][1]};
            shares[at].triangles = inner[k][2];
        }
        rest = at - 1;
    }
}

/* Four-wide walks of it want three entries a level: it is cut sooner than below depth 40, so that they fit their stack.
 */
static void chain(void **state)
{
    (void)state;
    enum { TRIANGLES = 400 };
    static struct kiln_gpu_bvh_node nodes[2 * TRIANGLES - 1];
    static struct kiln_gpu_bvh_subtree shares[2 * TRIANGLES - 1];
    struct world *w = world_create(3 * TRIANGLES, TRIANGLES);
    struct bvh *bvh = NULL;
    struct bvh_layout layout[LAYOUTS];
    add_soup(w, TRIANGLES, 1.0f, 0.2f, 0.2f);
    world_finish(w);
    chain_nodes(nodes, shares, TRIANGLES);
    assert_int_equal(bvh_create_of(&bvh, &w->g, &(struct bvh_params){0}, nodes, shares, NULL), KILN_OK);
    for (int i = 0; i < LAYOUTS; i++) {
        assert_int_equal(bvh_layout_create(&layout[i], bvh, layouts[i], NULL), KILN_OK);
        assert_int_equal(layout[i].triangle_count, TRIANGLES);
    }
    assert_in_range(layout[0].stack, 100, KILN_GPU_STACK4);
    assert_in_range(layout[1].stack, 1, KILN_GPU_STACK8);
    for (int i = 0; i < LAYOUTS; i++)
        bvh_layout_free(&layout[i]);
    bvh_destroy(&bvh);
    world_destroy(w);
}

/* Thousands of triangles in one place among more than the host joins from above: rounds on the device go on. (Mesa's
 * llvmpipe leaves a loop after 65,535 rounds, so they are not all in one place.) */
static void one_place(void **state)
{
    enum { SAME = 4000, OTHERS = KILN_BVH_TOP + 2000 };
    struct world *w = world_create(3 + 3 * OTHERS, SAME + OTHERS);
    add_soup(w, 1, 0.1f, 1.0f, 1.0f);
    for (int i = 1; i < SAME; i++)
        add_triangle(w, 0, 1, 2);
    add_soup(w, OTHERS, 1.0f, 0.04f, 0.04f);
    any_rays(w, 1.0f);
    check_world(*state, w, 16, false, 0);
}

/* Long thin triangles in worlds of a millimetre and of a thousand kilometres. */
static void any_scale(void **state)
{
    static const float scales[] = {1e-3f, 1e6f};
    for (size_t i = 0; i < 2; i++) {
        struct world *w = world_create(12000, 4000);
        add_soup(w, 2000, scales[i], 0.1f * scales[i], 0.1f * scales[i]);
        add_soup(w, 2000, scales[i], 1.5f * scales[i], 1e-4f * scales[i]);
        any_rays(w, scales[i]);
        check_world(*state, w, 16, false, 0);
    }
}

/* The device builds the same tree again, with any threads of the host. */
static void same_tree_again(void **state)
{
    enum { TRIANGLES = 60000 };
    const struct tracer *t = *state;
    struct world *w = world_create(3 * TRIANGLES, TRIANGLES);
    struct bvh_layout layout[2];
    add_soup(w, TRIANGLES, 1.0f, 0.05f, 0.05f);
    world_finish(w);
    for (uint32_t i = 0; i < 2; i++) {
        struct bvh_device *tree = NULL;
        struct bvh *bvh = NULL;
        assert_int_equal(bvh_device_create(&tree, t->gpu, &w->g, 1 + 2 * i, NULL), KILN_OK);
        assert_int_equal(bvh_device_fetch(tree, &(struct bvh_params){.threads = 2}, &bvh, NULL), KILN_OK);
        assert_true(bvh_is_of_device(bvh));
        assert_int_equal(bvh_layout_create(&layout[i], bvh, KILN_TRAVERSAL_FOUR, NULL), KILN_OK);
        bvh_destroy(&bvh);
        bvh_device_destroy(&tree);
    }
    assert_int_equal(layout[0].node_count, layout[1].node_count);
    assert_memory_equal(layout[0].nodes, layout[1].nodes, layout[0].node_count * layout[0].node_size);
    assert_memory_equal(layout[0].triangles, layout[1].triangles, TRIANGLES * sizeof *layout[0].triangles);
    for (int i = 0; i < 2; i++)
        bvh_layout_free(&layout[i]);
    world_destroy(w);
}

/* Ray tracing of the device's own is started where it may be used: not for a few rays, unless it is asked for. */
static void few_rays(void **state)
{
    (void)state;
    struct kiln_backend_params params = {.traversal = KILN_TRAVERSE_AUTO};
    assert_true(vulkan_tracer_may_be_pipeline(&params)); /* nothing is known of the rays */
    params.rays = 1e6;
    assert_false(vulkan_tracer_may_be_pipeline(&params));
    params.rays = 1e12;
    assert_true(vulkan_tracer_may_be_pipeline(&params));
    params.traversal = KILN_TRAVERSE_COMPUTE;
    assert_false(vulkan_tracer_may_be_pipeline(&params));
    params.traversal = KILN_TRAVERSE_PIPELINE;
    params.rays = 1e6;
    assert_true(vulkan_tracer_may_be_pipeline(&params));
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(threads_do_not_matter),
                                       cmocka_unit_test(box_room),
                                       cmocka_unit_test(balls_in_a_room),
                                       cmocka_unit_test(edges_and_corners),
                                       cmocka_unit_test(soup_and_needles),
                                       cmocka_unit_test(poor_triangles),
                                       cmocka_unit_test(hardly_any),
                                       cmocka_unit_test(too_deep),
                                       cmocka_unit_test(chain),
                                       cmocka_unit_test(one_place),
                                       cmocka_unit_test(any_scale),
                                       cmocka_unit_test(same_tree_again),
                                       cmocka_unit_test(few_rays)};
    if (!vulkan_device_is_there())
        return 77;
    return cmocka_run_group_tests(tests, tracer_open, tracer_close);
}
