#include "worker/backend/vulkan/bvh_top.h"

#include <math.h>
#include <omp.h>
#include <stdbool.h>
#include <stdlib.h>

#include "worker/base/arena.h"
#include "worker/base/memory.h"

enum {
    TASK_CLUSTERS = 512, /* clusters that are worth a task of their own */
    DEPTH_LIMIT = 32     /* below this depth ranges are halved */
};
static const float HARDLY_LESS = 1e-5f; /* relative difference up to which splits are equal: the more even is used */

struct work {
    const struct bvh_top *top;
    uint32_t *order[3]; /* clusters sorted by their middles along each axis */
    uint32_t *kept;     /* while a range is partitioned: clusters of its second half */
    float *right;       /* during a sweep: areas times triangles from each cluster on */
    uint8_t *second;    /* per cluster: 1 if it goes to the second half */
    struct kiln_arena arena;
};

/* A range of clusters, the same ones in all three orders, and the first node made from it. */
struct range {
    uint32_t first, count, node, depth;
};

struct split {
    float cost;
    uint32_t axis, first; /* clusters of the first half */
};

static float area_of(const struct kiln_gpu_bvh_node *n, float inverse_extent)
{
    const float x = (n->upper[0] - n->lower[0]) * inverse_extent, y = (n->upper[1] - n->lower[1]) * inverse_extent,
                z = (n->upper[2] - n->lower[2]) * inverse_extent;
    return x * y + y * z + z * x;
}

static void join(struct kiln_gpu_bvh_node *to, const struct kiln_gpu_bvh_node *other)
{
    for (int k = 0; k < 3; k++) {
        to->lower[k] = fminf(to->lower[k], other->lower[k]);
        to->upper[k] = fmaxf(to->upper[k], other->upper[k]);
    }
}

static uint32_t triangles_of(const struct kiln_gpu_bvh_subtree *share) { return share->triangles & ~KILN_GPU_LEAF; }

/* ---- where to split ---- */

static uint32_t from_middle(uint32_t first, uint32_t count)
{
    return 2 * first > count ? 2 * first - count : count - 2 * first;
}

static void sweep(const struct work *w, const struct range *r, uint32_t axis, struct split *best)
{
    const struct bvh_top *top = w->top;
    const uint32_t *order = w->order[axis] + r->first;
    float *right = w->right + r->first;
    struct kiln_gpu_bvh_node box = top->clusters[order[r->count - 1]];
    uint32_t triangles = 0;
    for (uint32_t i = r->count - 1; i > 0; i--) {
        join(&box, &top->clusters[order[i]]);
        triangles += triangles_of(&top->subtrees[order[i]]);
        right[i] = area_of(&box, top->inverse_extent) * (float)triangles;
    }
    box = top->clusters[order[0]];
    triangles = 0;
    for (uint32_t i = 1; i < r->count; i++) {
        join(&box, &top->clusters[order[i - 1]]);
        triangles += triangles_of(&top->subtrees[order[i - 1]]);
        const float cost = area_of(&box, top->inverse_extent) * (float)triangles + right[i];
        const bool less = cost < best->cost * (1.0f - HARDLY_LESS), equal = cost <= best->cost * (1.0f + HARDLY_LESS);
        if (less || (equal && from_middle(i, r->count) < from_middle(best->first, r->count)))
            *best = (struct split){cost, axis, i};
    }
}

/* Partitions a range in all orders: clusters of the first half come before those of the second. */
static void part(const struct work *w, const struct range *r, const struct split *split)
{
    for (uint32_t i = 0; i < r->count; i++)
        w->second[w->order[split->axis][r->first + i]] = i >= split->first;
    for (uint32_t k = 0; k < 3; k++) {
        uint32_t *order = w->order[k] + r->first, *kept = w->kept + r->first, stay = 0, go = 0;
        for (uint32_t i = 0; i < r->count; i++) {
            const uint32_t cluster = order[i];
            if (w->second[cluster])
                kept[go++] = cluster;
            else
                order[stay++] = cluster;
        }
        for (uint32_t i = 0; i < go; i++)
            order[stay + i] = kept[i];
    }
}

/* ---- nodes ---- */

/* Returns the least cost of two subtrees as children of one node: shaders/bvh.glsl. */
static float distribute(const float a[3], const float b[3], uint32_t room)
{
    float least = a[0] + b[room - 2];
    for (uint32_t k = 2; k < room; k++)
        least = fminf(least, a[k - 1] + b[room - k - 1]);
    return least;
}

/* shaders/bvh_cluster.comp */
static struct kiln_gpu_bvh_subtree share_of(const struct kiln_gpu_bvh_subtree *a, const struct kiln_gpu_bvh_subtree *b,
                                            float area)
{
    const uint32_t triangles = triangles_of(a) + triangles_of(b);
    const float apart = area + distribute(a->cost, b->cost, 4), together = area * (float)triangles;
    const bool leaf = triangles <= KILN_BVH_LEAF && together <= apart;
    const float one = leaf ? together : apart, two = fminf(one, distribute(a->cost, b->cost, 2));
    return (struct kiln_gpu_bvh_subtree){leaf ? KILN_GPU_LEAF | triangles : triangles,
                                         {one, two, fminf(two, distribute(a->cost, b->cost, 3))}};
}

/* Number of a range's root, its box, and its triangles and cost. */
static uint32_t root_of(const struct work *w, const struct range *r, struct kiln_gpu_bvh_node *box,
                        struct kiln_gpu_bvh_subtree *share)
{
    const struct bvh_top *top = w->top;
    const uint32_t cluster = w->order[0][r->first], made = r->node + r->count - 2;
    *box = r->count == 1 ? top->clusters[cluster] : top->nodes[made];
    *share = r->count == 1 ? top->subtrees[cluster] : top->node_subtrees[made];
    return r->count == 1 ? top->names[cluster] : top->first + made;
}

static void build(const struct work *w, struct range r)
{
    struct split split = {INFINITY, 0, r.count / 2};
    if (r.count == 1)
        return;
    for (uint32_t axis = 0; axis < 3 && r.depth < DEPTH_LIMIT; axis++)
        sweep(w, &r, axis, &split);
    part(w, &r, &split);
    const struct range a = {r.first, split.first, r.node, r.depth + 1},
                       b = {r.first + split.first, r.count - split.first, r.node + split.first - 1, r.depth + 1};
#pragma omp task firstprivate(w, a) if (a.count >= TASK_CLUSTERS)
    build(w, a);
    build(w, b);
#pragma omp taskwait
    struct kiln_gpu_bvh_node node, second;
    struct kiln_gpu_bvh_subtree share_a, share_b;
    const uint32_t name_a = root_of(w, &a, &node, &share_a), name_b = root_of(w, &b, &second, &share_b);
    join(&node, &second);
    node.first = name_a;
    node.second = name_b;
    w->top->nodes[r.node + r.count - 2] = node;
    w->top->node_subtrees[r.node + r.count - 2] = share_of(&share_a, &share_b, area_of(&node, w->top->inverse_extent));
}

/* ---- orders ---- */

struct middle {
    float at;
    uint32_t cluster;
};

static int compare(const void *a, const void *b)
{
    const struct middle *x = a, *y = b;
    if (x->at != y->at)
        return x->at < y->at ? -1 : 1;
    return x->cluster < y->cluster ? -1 : 1;
}

static int order_along(const struct work *w, uint32_t axis)
{
    const uint32_t count = w->top->count;
    struct middle *middles = NULL;
    if (kiln_allocate(&middles, count, sizeof *middles, "the top of the BVH", NULL) != KILN_OK)
        return KILN_SYSTEM;
    for (uint32_t i = 0; i < count; i++)
        middles[i] = (struct middle){w->top->clusters[i].lower[axis] + w->top->clusters[i].upper[axis], i};
    qsort(middles, count, sizeof *middles, compare);
    for (uint32_t i = 0; i < count; i++)
        w->order[axis][i] = middles[i].cluster;
    kiln_free(&middles);
    return KILN_OK;
}

static int order_all(const struct work *w, int threads, struct kiln_error *error)
{
    int failed = 0;
#pragma omp parallel for num_threads(threads) reduction(+ : failed)
    for (uint32_t axis = 0; axis < 3; axis++)
        failed += order_along(w, axis) != KILN_OK;
    return failed == 0 ? KILN_OK : kiln_fail(error, KILN_SYSTEM, "there is too little memory for the top of the BVH");
}

int bvh_top_build(const struct bvh_top *top, struct kiln_error *error)
{
    static const char what[] = "the top of the BVH";
    const int threads = top->threads != 0 ? (int)top->threads : omp_get_num_procs();
    struct work w = {.top = top};
    int status;
    KILN_TRY(kiln_arena_allocate(&w.arena, &w.kept, top->count, sizeof *w.kept, what, error));
    KILN_TRY(kiln_arena_allocate(&w.arena, &w.right, top->count, sizeof *w.right, what, error));
    KILN_TRY(kiln_arena_allocate(&w.arena, &w.second, top->count, sizeof *w.second, what, error));
    for (int i = 0; i < 3; i++)
        KILN_TRY(kiln_allocate(&w.order[i], top->count, sizeof *w.order[i], what, error));
    KILN_TRY(order_all(&w, threads, error));
#pragma omp parallel num_threads(threads)
#pragma omp single
    build(&w, (struct range){0, top->count, 0, 0});
end:
    for (int i = 0; i < 3; i++)
        kiln_free(&w.order[i]);
    kiln_arena_release(&w.arena);
    return status;
}
