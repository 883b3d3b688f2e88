#include "worker/backend/vulkan/bvh_device.h"

#include <assert.h>
#include <math.h>
#include <string.h>

#include "shaders/modules.h"
#include "shaders/shared/push.h"
#include "worker/backend/vulkan/bvh_top.h"
#include "worker/base/arena.h"
#include "worker/base/memory.h"

enum {
    BVH_RADIUS = 16,   /* neighbours on either side that a cluster examines; at most KILN_BVH_RADIUS */
    ROUNDS = 8,        /* of a submission */
    FEW_LEFT_PART = 8, /* if a round joins fewer than one cluster in so many, adjacent clusters are joined next */
    CODE_BITS = 64,    /* of keys */
    STEPS_MOST = 96,   /* of a submission */
    LEVELS_MOST = (KILN_GPU_STACK4 - 1) / 3 /* levels of a layout, limited by the stack of a traversal */
};

enum kernel { SORT, CLUSTER, LAYOUT, KERNELS };
enum array {
    VERTICES,
    INDICES,
    KEYS,
    KEYS_AFTER,
    VALUES,
    VALUES_AFTER,
    HISTOGRAM,
    SUMS,
    NODES,
    SUBTREES,
    CLUSTERS,
    CLUSTERS_AFTER,
    NEAREST,
    LEFT,
    LEFT_SUBTREES,
    STATES,
    TASKS,
    ROOT,
    ARRAYS
};

static const char what[] = "building the BVH";

struct bvh_device {
    struct gpu *gpu;
    const struct kiln_geometry *geometry;
    uint32_t count; /* triangles */
    uint32_t threads;
    struct gpu_kernel *kernels[KERNELS];
    struct gpu_buffer arrays[ARRAYS];
    struct gpu_buffer answer; /* on the host: struct kiln_gpu_bvh_state twice and a word */
    struct kiln_gpu_bvh root;
};

/* A submission in the making. */
struct script {
    struct gpu_step steps[STEPS_MOST];
    struct kiln_gpu_bvh_push pushes[STEPS_MOST];
    size_t count;
};

static uint64_t bytes_of(uint64_t count, const struct kiln_geometry *g, enum array array)
{
    const uint64_t groups = (count + KILN_BVH_SORTED - 1) / KILN_BVH_SORTED;
    switch (array) {
    case VERTICES:
        return 3 * sizeof(float) * g->vertex_count;
    case INDICES:
        return 3 * sizeof(uint32_t) * g->triangle_count;
    case KEYS:
    case KEYS_AFTER:
        return count * sizeof(uint64_t);
    case HISTOGRAM:
        return groups * KILN_BVH_DIGITS * sizeof(uint32_t);
    case SUMS:
        return (count / 64 + 1) * sizeof(uint32_t);
    case NODES:
        return (2 * count - 1) * sizeof(struct kiln_gpu_bvh_node);
    case SUBTREES:
        return (2 * count - 1) * sizeof(struct kiln_gpu_bvh_subtree);
    case STATES:
        return 2 * sizeof(struct kiln_gpu_bvh_state) + sizeof(uint64_t);
    case LEFT:
        return (count < KILN_BVH_TOP ? count : KILN_BVH_TOP) * sizeof(struct kiln_gpu_bvh_node);
    case LEFT_SUBTREES:
        return (count < KILN_BVH_TOP ? count : KILN_BVH_TOP) * sizeof(struct kiln_gpu_bvh_subtree);
    case TASKS:
        return count * sizeof(struct kiln_gpu_bvh_task);
    case ROOT:
        return sizeof(struct kiln_gpu_bvh);
    default: /* a word of each triangle */
        return count * sizeof(uint32_t);
    }
}

bool bvh_device_can(const struct gpu *gpu, const struct kiln_geometry *geometry)
{
    const uint64_t count = kiln_geometry_hittable_count(geometry);
    if (count == 0 || geometry->triangle_count > KILN_GPU_LEAF_FIRST)
        return false;
    /* tasks are allocated after half of the arrays are freed; a layout needs less than a node of 128 bytes for two
     * triangles */
    uint64_t bytes = count * (sizeof(struct kiln_gpu_bvh4_node) / 2 + sizeof(struct kiln_gpu_triangle));
    for (int i = 0; i < ARRAYS; i++)
        bytes += bytes_of(count, geometry, (enum array)i);
    return bytes < gpu_memory_left(gpu) / 8 * 7;
}

/* ---- steps ---- */

static void add(struct script *s, const struct bvh_device *t, enum kernel kernel, uint32_t threads,
                struct kiln_gpu_bvh_push push)
{
    assert(s->count < STEPS_MOST);
    push.bvh = t->arrays[ROOT].address;
    s->pushes[s->count] = push;
    s->steps[s->count] = (struct gpu_step){.kernel = t->kernels[kernel],
                                           .threads_x = threads,
                                           .threads_y = 1,
                                           .constants = &s->pushes[s->count],
                                           .constant_bytes = sizeof push};
    s->count++;
}

/* Threads for `count` items, with `a_group` items per group of 64 threads. */
static uint32_t groups_for(uint32_t count, uint32_t a_group)
{
    return (uint32_t)(((uint64_t)count + a_group - 1) / a_group) * 64;
}

static int run(struct script *s, const struct bvh_device *t, struct kiln_error *error)
{
    const int status = gpu_run(t->gpu, s->steps, s->count, NULL, error);
    s->count = 0;
    return status;
}

/* Runs the script's steps, and then copies the states from the device to t->answer on the host. */
static int run_and_ask(struct script *s, const struct bvh_device *t, struct kiln_error *error)
{
    assert(s->count < STEPS_MOST);
    s->steps[s->count++] =
        (struct gpu_step){.from = &t->arrays[STATES], .to = &t->answer, .size = t->arrays[STATES].size};
    return run(s, t, error);
}

/* ---- the tree ---- */

static int make_kernels(struct bvh_device *t, struct kiln_error *error)
{
    static const struct gpu_kernel_params params[KERNELS] = {
        [SORT] = {.name = "bvh_sort", .code = &kiln_code_bvh_sort},
        [CLUSTER] = {.name = "bvh_cluster", .code = &kiln_code_bvh_cluster},
        [LAYOUT] = {.name = "bvh_layout", .code = &kiln_code_bvh_layout}};
    int status = KILN_OK;
    for (int i = 0; i < KERNELS && status == KILN_OK; i++)
        status = gpu_kernel_create(t->gpu, &t->kernels[i], &params[i], error);
    return status;
}

static int make_arrays(struct bvh_device *t, struct kiln_error *error)
{
    const struct kiln_geometry *g = t->geometry;
    int status = KILN_OK;
    for (int i = 0; i < ARRAYS; i++)
        if (i != TASKS)
            KILN_TRY(gpu_buffer_create(t->gpu, &t->arrays[i], (size_t)bytes_of(t->count, g, (enum array)i), GPU_DEVICE,
                                       what, error));
    KILN_TRY(gpu_buffer_create(t->gpu, &t->answer, t->arrays[STATES].size, GPU_HOST, what, error));
    KILN_TRY(gpu_fill(t->gpu, &t->arrays[VERTICES], 0, g->vertices, t->arrays[VERTICES].size, error));
    KILN_TRY(gpu_fill(t->gpu, &t->arrays[INDICES], 0, g->indices, t->arrays[INDICES].size, error));
end:
    return status;
}

static int bring_root(struct bvh_device *t, struct kiln_error *error)
{
    const struct gpu_buffer *a = t->arrays;
    struct kiln_gpu_bvh *root = &t->root;
    root->vertices = a[VERTICES].address;
    root->indices = a[INDICES].address;
    for (int i = 0; i < 2; i++) {
        root->keys[i] = a[KEYS + i].address;
        root->values[i] = a[VALUES + i].address;
        root->clusters[i] = a[CLUSTERS + i].address;
    }
    root->histogram = a[HISTOGRAM].address;
    root->sums = a[SUMS].address;
    root->nodes = a[NODES].address;
    root->subtrees = a[SUBTREES].address;
    root->nearest = a[NEAREST].address;
    root->left = a[LEFT].address;
    root->left_subtrees = a[LEFT_SUBTREES].address;
    root->states = a[STATES].address;
    root->tasks = a[TASKS].address;
    return gpu_upload(t->gpu, &a[ROOT], 0, root, sizeof *root, error);
}

static void describe(struct bvh_device *t)
{
    const struct kiln_geometry *g = t->geometry;
    const struct kiln_vec3 size = vec3_sub(g->bounds_max, g->bounds_min);
    const float edge = fmaxf(fmaxf(size.x, fmaxf(size.y, size.z)), 1e-30f);
    t->root = (struct kiln_gpu_bvh){.origin = {g->bounds_min.x, g->bounds_min.y, g->bounds_min.z},
                                    .steps = 0x1p21f / edge,
                                    .margin = bvh_margin(g),
                                    .inverse_extent = 1.0f / fmaxf(g->extent, 1e-30f),
                                    .count = t->count,
                                    .before = (uint32_t)(g->opaque_count - g->opaque_receivers),
                                    .skipped = (uint32_t)g->opaque_receivers};
}

static int sort(struct bvh_device *t, struct script *s, struct kiln_error *error)
{
    const uint32_t words = (uint32_t)(t->arrays[HISTOGRAM].size / sizeof(uint32_t)), n = t->count,
                   groups = groups_for(words, KILN_BVH_ADDED);
    uint32_t from = 0;
    add(s, t, SORT, n, (struct kiln_gpu_bvh_push){.stage = KILN_BVH_CODE, .count = n});
    for (uint32_t shift = 0; shift < CODE_BITS; shift += KILN_BVH_DIGIT_BITS) {
        const struct kiln_gpu_bvh_push keys = {.count = n, .from = from, .shift = shift}, sums = {.count = words};
        struct kiln_gpu_bvh_push push = keys;
        push.stage = KILN_BVH_COUNT;
        add(s, t, SORT, groups_for(n, KILN_BVH_SORTED), push);
        push = sums;
        push.stage = KILN_BVH_ADD;
        add(s, t, SORT, groups, push);
        push.stage = KILN_BVH_RISE;
        push.count = groups / 64;
        add(s, t, SORT, 64, push);
        push = sums;
        push.stage = KILN_BVH_FILL;
        add(s, t, SORT, groups, push);
        push = keys;
        push.stage = KILN_BVH_PLACE;
        add(s, t, SORT, groups_for(n, KILN_BVH_SORTED), push);
        from ^= 1u;
    }
    add(s, t, SORT, n, (struct kiln_gpu_bvh_push){.stage = KILN_BVH_LEAVES, .count = n, .from = from});
    return run(s, t, error);
}

static void add_round(struct bvh_device *t, struct script *s, uint32_t clusters, uint32_t from, bool pair)
{
    struct kiln_gpu_bvh_push push = {.from = from, .radius = BVH_RADIUS};
    push.stage = pair ? KILN_BVH_PAIR : KILN_BVH_NEAREST;
    add(s, t, CLUSTER, clusters, push);
    push.stage = KILN_BVH_GONE;
    add(s, t, CLUSTER, groups_for(clusters, KILN_BVH_ADDED), push);
    push.stage = KILN_BVH_LEFT;
    add(s, t, CLUSTER, 64, push);
    push.stage = KILN_BVH_JOIN;
    add(s, t, CLUSTER, groups_for(clusters, KILN_BVH_ADDED), push);
}

/* Joins clusters in a few rounds; *from: which of the two arrays holds those that are left. */
static int join(struct bvh_device *t, struct script *s, struct kiln_gpu_bvh_state *left, uint32_t *from,
                struct kiln_error *error)
{
    bool pair = false;
    int status = KILN_OK;
    *left = (struct kiln_gpu_bvh_state){t->count, 0};
    for (*from = 0; left->clusters > KILN_BVH_TOP && status == KILN_OK;) {
        const uint32_t clusters = left->clusters;
        for (int i = 0; i < ROUNDS; i++, *from ^= 1u)
            add_round(t, s, clusters, *from, pair && i == 0);
        status = run_and_ask(s, t, error);
        *left = ((const struct kiln_gpu_bvh_state *)t->answer.mapped)[*from];
        pair = left->clusters > clusters - clusters / FEW_LEFT_PART;
    }
    return status;
}

/* Arrays from which the host builds the top of the tree. */
struct top {
    struct kiln_gpu_bvh_node *clusters, *nodes;
    struct kiln_gpu_bvh_subtree *subtrees, *node_subtrees;
    uint32_t *names;
    struct kiln_arena arena;
};

static int allocate_top(struct top *top, uint32_t count, struct kiln_error *error)
{
    int status;
    KILN_TRY(kiln_arena_allocate(&top->arena, &top->clusters, count, sizeof *top->clusters, what, error));
    KILN_TRY(kiln_arena_allocate(&top->arena, &top->nodes, count, sizeof *top->nodes, what, error));
    KILN_TRY(kiln_arena_allocate(&top->arena, &top->subtrees, count, sizeof *top->subtrees, what, error));
    KILN_TRY(kiln_arena_allocate(&top->arena, &top->node_subtrees, count, sizeof *top->node_subtrees, what, error));
    KILN_TRY(kiln_arena_allocate(&top->arena, &top->names, count, sizeof *top->names, what, error));
end:
    return status;
}

static void free_top(struct top *top) { kiln_arena_release(&top->arena); }

static int build_top(struct bvh_device *t, const struct top *top, const struct kiln_gpu_bvh_state *left, uint32_t from,
                     struct kiln_error *error)
{
    const size_t count = left->clusters, first = (size_t)t->count + left->made;
    const struct bvh_top work = {.clusters = top->clusters,
                                 .subtrees = top->subtrees,
                                 .names = top->names,
                                 .count = left->clusters,
                                 .first = (uint32_t)first,
                                 .inverse_extent = t->root.inverse_extent,
                                 .threads = t->threads,
                                 .nodes = top->nodes,
                                 .node_subtrees = top->node_subtrees};
    int status;
    KILN_TRY(gpu_download(t->gpu, &t->arrays[LEFT], 0, top->clusters, count * sizeof *top->clusters, error));
    KILN_TRY(gpu_download(t->gpu, &t->arrays[LEFT_SUBTREES], 0, top->subtrees, count * sizeof *top->subtrees, error));
    KILN_TRY(gpu_download(t->gpu, &t->arrays[CLUSTERS + (int)from], 0, top->names, count * sizeof *top->names, error));
    KILN_TRY(bvh_top_build(&work, error));
    KILN_TRY(gpu_upload(t->gpu, &t->arrays[NODES], first * sizeof *top->nodes, top->nodes,
                        (count - 1) * sizeof *top->nodes, error));
    KILN_TRY(gpu_upload(t->gpu, &t->arrays[SUBTREES], first * sizeof *top->node_subtrees, top->node_subtrees,
                        (count - 1) * sizeof *top->node_subtrees, error));
end:
    return status;
}

static int join_top(struct bvh_device *t, struct script *s, const struct kiln_gpu_bvh_state *left, uint32_t from,
                    struct kiln_error *error)
{
    struct top top = {.clusters = NULL};
    if (left->clusters < 2)
        return KILN_OK;
    add(s, t, CLUSTER, left->clusters, (struct kiln_gpu_bvh_push){.stage = KILN_BVH_GIVE, .from = from});
    int status;
    KILN_TRY(run(s, t, error));
    KILN_TRY(allocate_top(&top, left->clusters, error));
    KILN_TRY(build_top(t, &top, left, from, error));
end:
    free_top(&top);
    return status;
}

static int build(struct bvh_device *t, struct kiln_error *error)
{
    const struct kiln_gpu_bvh_state states[3] = {{t->count, 0}, {0, 0}, {0, 0}};
    struct script *s = NULL;
    int status = kiln_allocate(&s, 1, sizeof *s, what, error);
    describe(t);
    KILN_TRY(status);
    KILN_TRY(make_kernels(t, error));
    KILN_TRY(make_arrays(t, error));
    KILN_TRY(gpu_upload(t->gpu, &t->arrays[STATES], 0, states, sizeof states, error));
    KILN_TRY(bring_root(t, error));
    KILN_TRY(sort(t, s, error));
    struct kiln_gpu_bvh_state left;
    uint32_t from;
    KILN_TRY(join(t, s, &left, &from, error));
    KILN_TRY(join_top(t, s, &left, from, error));
end:
    for (int i = KEYS; i <= HISTOGRAM; i++)
        gpu_buffer_destroy(t->gpu, &t->arrays[i]);
    for (int i = CLUSTERS; i <= LEFT_SUBTREES; i++)
        gpu_buffer_destroy(t->gpu, &t->arrays[i]);
    kiln_free(&s);
    return status;
}

int bvh_device_create(struct bvh_device **tree, struct gpu *gpu, const struct kiln_geometry *geometry, uint32_t threads,
                      struct kiln_error *error)
{
    struct bvh_device *t = NULL;
    *tree = NULL;
    int status = kiln_allocate(&t, 1, sizeof *t, what, error);
    if (status != KILN_OK)
        return status;
    t->gpu = gpu;
    t->geometry = geometry;
    t->threads = threads;
    t->count = (uint32_t)kiln_geometry_hittable_count(geometry);
    assert(t->count > 0 && geometry->triangle_count <= KILN_GPU_LEAF_FIRST);
    status = build(t, error);
    if (status == KILN_OK)
        *tree = t;
    else
        bvh_device_destroy(&t);
    return status;
}

void bvh_device_destroy(struct bvh_device **tree)
{
    struct bvh_device *t = *tree;
    if (t == NULL)
        return;
    for (int i = 0; i < KERNELS; i++)
        gpu_kernel_destroy(t->gpu, &t->kernels[i]);
    for (int i = 0; i < ARRAYS; i++)
        gpu_buffer_destroy(t->gpu, &t->arrays[i]);
    gpu_buffer_destroy(t->gpu, &t->answer);
    kiln_free(tree);
}

/* ---- layouts ---- */

/* The tasks of each level of a layout. */
struct levels {
    uint32_t first[LEVELS_MOST + 1]; /* and behind the last */
    uint32_t count;
};

/* Opens the levels from the root down, as far as a stack allows. */
static int open_levels(struct bvh_device *t, struct script *s, struct levels *l, struct kiln_error *error)
{
    const struct kiln_gpu_bvh_task root = {.node = 2 * t->count - 2, .free = 1};
    uint32_t open = 1;
    int status = gpu_upload(t->gpu, &t->arrays[TASKS], 0, &root, sizeof root, error);
    l->count = l->first[0] = 0;
    for (; open > 0 && l->count < LEVELS_MOST && status == KILN_OK; l->count++) {
        const uint32_t next = l->first[l->count] + open;
        struct kiln_gpu_bvh_push push = {
            .count = open, .first = l->first[l->count], .next = next, .stage = KILN_BVH_OPEN};
        add(s, t, LAYOUT, open, push);
        push.stage = KILN_BVH_LEVEL;
        add(s, t, LAYOUT, 64, push);
        push.stage = KILN_BVH_NEXT;
        add(s, t, LAYOUT, open, push);
        status = run_and_ask(s, t, error);
        l->first[l->count + 1] = next;
        open = status == KILN_OK ? ((const uint32_t *)t->answer.mapped)[4] : 0;
    }
    l->count += open > 0 ? 1 : 0; /* one too many */
    return status;
}

/* Places by depth, and the layout. */
static int write_layout(struct bvh_device *t, struct script *s, const struct levels *l,
                        struct bvh_device_layout *layout, struct kiln_error *error)
{
    layout->node_count = l->first[l->count];
    layout->triangle_count = t->count;
    int status = gpu_buffer_create(t->gpu, &layout->nodes, layout->node_count * sizeof(struct kiln_gpu_bvh4_node),
                                   GPU_DEVICE, "the BVH", error);
    if (status == KILN_OK)
        status = gpu_buffer_create(t->gpu, &layout->triangles, t->count * sizeof(struct kiln_gpu_triangle), GPU_DEVICE,
                                   "the BVH's triangles", error);
    if (status != KILN_OK)
        return status;
    t->root.layout_nodes = layout->nodes.address;
    t->root.layout_triangles = layout->triangles.address;
    KILN_TRY(bring_root(t, error));
    for (uint32_t i = 0; i + 1 < 2 * l->count; i++) {
        const bool up = i < l->count - 1;
        const uint32_t level = up ? l->count - 2 - i : i - (l->count - 1);
        if (level + 1 == l->count)
            continue; /* the last has none below */
        const struct kiln_gpu_bvh_push push = {.count = l->first[level + 1] - l->first[level],
                                               .first = l->first[level],
                                               .next = l->first[level + 2],
                                               .stage = up ? KILN_BVH_BELOW : KILN_BVH_SETTLE};
        add(s, t, LAYOUT, push.count, push);
        if (s->count == STEPS_MOST)
            KILN_TRY(run(s, t, error));
    }
    if (s->count == STEPS_MOST)
        KILN_TRY(run(s, t, error));
end:
    if (status != KILN_OK)
        return status;
    add(s, t, LAYOUT, (uint32_t)layout->node_count,
        (struct kiln_gpu_bvh_push){.stage = KILN_BVH_WRITE, .count = (uint32_t)layout->node_count});
    return run(s, t, error);
}

/* Finds the levels of a layout; *too_deep: there are more than a stack allows. */
static int find_levels(struct bvh_device *t, struct script *s, struct levels *l, bool *too_deep,
                       struct kiln_error *error)
{
    int status = KILN_OK;
    *l = (struct levels){.count = 0};
    if (t->arrays[TASKS].address == 0) {
        status = gpu_buffer_create(t->gpu, &t->arrays[TASKS], (size_t)bytes_of(t->count, t->geometry, TASKS),
                                   GPU_DEVICE, what, error);
        status = status == KILN_OK ? bring_root(t, error) : status;
    }
    if (status == KILN_OK)
        status = open_levels(t, s, l, error);
    *too_deep = l->count > LEVELS_MOST;
    return status;
}

int bvh_device_fits(struct bvh_device *tree, bool *fits, struct kiln_error *error)
{
    struct levels levels;
    struct script *s = NULL;
    bool too_deep = false;
    int status = kiln_allocate(&s, 1, sizeof *s, what, error);
    if (status == KILN_OK)
        status = find_levels(tree, s, &levels, &too_deep, error);
    *fits = !too_deep;
    kiln_free(&s);
    return status;
}

int bvh_device_layout_create(struct bvh_device *tree, struct bvh_device_layout *layout, bool *too_deep,
                             struct kiln_error *error)
{
    struct levels levels = {.count = 0};
    struct script *s = NULL;
    *layout = (struct bvh_device_layout){.node_count = 0};
    *too_deep = false;
    int status = kiln_allocate(&s, 1, sizeof *s, what, error);
    if (status == KILN_OK)
        status = find_levels(tree, s, &levels, too_deep, error);
    layout->stack = 3 * levels.count + 1;
    if (status == KILN_OK && !*too_deep)
        status = write_layout(tree, s, &levels, layout, error);
    if (status != KILN_OK)
        bvh_device_layout_free(layout, tree->gpu);
    kiln_free(&s);
    return status;
}

void bvh_device_layout_free(struct bvh_device_layout *layout, struct gpu *gpu)
{
    gpu_buffer_destroy(gpu, &layout->nodes);
    gpu_buffer_destroy(gpu, &layout->triangles);
    *layout = (struct bvh_device_layout){.node_count = 0};
}

/* ---- for the host ---- */

int bvh_device_fetch(struct bvh_device *tree, const struct bvh_params *params, struct bvh **bvh,
                     struct kiln_error *error)
{
    const size_t count = 2 * (size_t)tree->count - 1;
    struct kiln_gpu_bvh_node *nodes = NULL;
    struct kiln_gpu_bvh_subtree *subtrees = NULL;
    *bvh = NULL;
    int status;
    KILN_TRY(kiln_allocate(&nodes, count, sizeof *nodes, "the device's BVH", error));
    KILN_TRY(kiln_allocate(&subtrees, count, sizeof *subtrees, "the device's BVH", error));
    KILN_TRY(gpu_download(tree->gpu, &tree->arrays[NODES], 0, nodes, count * sizeof *nodes, error));
    KILN_TRY(gpu_download(tree->gpu, &tree->arrays[SUBTREES], 0, subtrees, count * sizeof *subtrees, error));
    KILN_TRY(bvh_create_of(bvh, tree->geometry, params, nodes, subtrees, error));
end:
    kiln_free(&nodes);
    kiln_free(&subtrees);
    return status;
}
