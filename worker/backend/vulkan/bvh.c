#include "worker/backend/vulkan/bvh.h"

#include <assert.h>
#include <embree3/rtcore.h>
#include <math.h>
#include <omp.h>
#include <stdio.h>
#include <string.h>

#include "worker/base/memory.h"

enum { LEAF_MOST = 3 /* the limit of a child of struct kiln_gpu_bvh8_node */, WIDTH_MOST = 8 };
enum {
    DEPTH_LIMIT = 40,
    /* largest depth of the tree, so that traversal stacks suffice: three entries per level four-wide, one eight-wide.
     * 2^29 leaves fit below depth 12 */
    DEPTH_MOST = (KILN_GPU_STACK4 - 1) / 3,
    DEPTH_LIMIT_LEAST = DEPTH_MOST - 29
};
_Static_assert(DEPTH_MOST <= KILN_GPU_STACK8, "eight-wide walks need no more");
enum { TASK_TRIANGLES = 2048 }; /* triangles of a subtree that is worth a task of its own */

struct box {
    float lower[3], upper[3];
};

/* A node of the flat tree. Children of a node are adjacent. */
struct node {
    struct box box;
    uint32_t first; /* first child; or first triangle of a leaf, in `order` */
    uint32_t count; /* triangles of a leaf; 0: a node with two children */
};

struct bvh {
    const struct kiln_geometry *geometry;
    struct node *nodes; /* the root first */
    size_t node_count;
    uint32_t *order; /* world triangles, leaf by leaf */
    size_t order_count;
    uint32_t depth_limit, threads;
    bool of_device; /* it built the tree */
};

/* Allocates memory without touching it, so that the threads that fill it share the cost of its pages. *pointer is NULL.
 */
static int allocate_untouched(void *pointer, size_t count, size_t size, const char *what, struct kiln_error *error)
{
    size_t room = 0;
    return kiln_grow(pointer, &room, count, size, what, error);
}

/* ---- callbacks of Embree's builder; memory is the builder's ---- */

struct built {
    uint32_t count;             /* of a leaf; 0: two children */
    uint32_t leaves, triangles; /* of the subtree */
    union {
        struct {
            struct built *child[2];
            struct box box[2];
        } inner;
        uint32_t triangle[LEAF_MOST];
    } is;
};

static void *create_node(RTCThreadLocalAllocator allocator, unsigned int child_count, void *user)
{
    (void)child_count;
    (void)user;
    struct built *node = rtcThreadLocalAlloc(allocator, sizeof *node, 16);
    node->count = 0;
    return node;
}

/* Callback: children are complete when they are passed. */

static void set_children(void *pointer, void **children, unsigned int child_count, void *user)
{
    (void)user;
    struct built *node = pointer;
    node->leaves = node->triangles = 0;
    for (unsigned i = 0; i < child_count; i++) {
        const struct built *child = children[i];
        node->is.inner.child[i] = children[i];
        node->leaves += child->leaves;
        node->triangles += child->triangles;
    }
}

static void set_bounds(void *pointer, const struct RTCBounds **bounds, unsigned int child_count, void *user)
{
    (void)user;
    struct built *node = pointer;
    for (unsigned i = 0; i < child_count; i++)
        node->is.inner.box[i] = (struct box){{bounds[i]->lower_x, bounds[i]->lower_y, bounds[i]->lower_z},
                                             {bounds[i]->upper_x, bounds[i]->upper_y, bounds[i]->upper_z}};
}

static void *create_leaf(RTCThreadLocalAllocator allocator, const struct RTCBuildPrimitive *primitives, size_t count,
                         void *user)
{
    (void)user;
    assert(count >= 1 && count <= LEAF_MOST);
    struct built *leaf = rtcThreadLocalAlloc(allocator, sizeof *leaf, 16);
    leaf->count = leaf->triangles = (uint32_t)count;
    leaf->leaves = 1;
    for (size_t i = 0; i < count; i++)
        leaf->is.triangle[i] = primitives[i].primID;
    return leaf;
}

/* ---- boxes ---- */

static struct box box_join(const struct box *a, const struct box *b)
{
    struct box box;
    for (int k = 0; k < 3; k++) {
        box.lower[k] = fminf(a->lower[k], b->lower[k]);
        box.upper[k] = fmaxf(a->upper[k], b->upper[k]);
    }
    return box;
}

static double box_area(const struct box *box)
{
    const double x = (double)box->upper[0] - (double)box->lower[0], y = (double)box->upper[1] - (double)box->lower[1],
                 z = (double)box->upper[2] - (double)box->lower[2];
    return x * y + y * z + z * x;
}

static struct box triangle_box(const struct kiln_geometry *g, size_t triangle, float margin)
{
    struct kiln_vec3 c[3];
    kiln_geometry_corners(g, triangle, c);
    return (struct box){{fminf(c[0].x, fminf(c[1].x, c[2].x)) - margin, fminf(c[0].y, fminf(c[1].y, c[2].y)) - margin,
                         fminf(c[0].z, fminf(c[1].z, c[2].z)) - margin},
                        {fmaxf(c[0].x, fmaxf(c[1].x, c[2].x)) + margin, fmaxf(c[0].y, fmaxf(c[1].y, c[2].y)) + margin,
                         fmaxf(c[0].z, fmaxf(c[1].z, c[2].z)) + margin}};
}

/* ---- from the builder's tree to the flat one ---- */

/* Where the descendants of a node are stored: its children adjacent, then all descendants of the first, then all of the
 * second; as one thread would store them. */
struct place {
    size_t node, triangle; /* the first that are free */
    uint32_t depth;        /* of the node */
};

/* A conversion from the builder's tree to the flat one, by all threads. */
struct flattening {
    struct bvh *bvh;
    uint32_t depth;          /* of the deepest node */
    int status;              /* of whichever task failed last */
    struct kiln_error error; /* its */
};

/* The place of the second child's descendants, if the first child has `leaves` leaves and `triangles` triangles. */
static struct place place_beside(const struct place *children, size_t leaves, size_t triangles)
{
    return (struct place){children->node + 2 * leaves - 2, children->triangle + triangles, children->depth};
}

static struct place place_of_children(const struct place *node)
{
    return (struct place){node->node + 2, node->triangle, node->depth + 1};
}

static void note_depth(struct flattening *f, uint32_t depth)
{
    uint32_t known;
#pragma omp atomic read
    known = f->depth;
    if (depth <= known)
        return;
#pragma omp critical(kiln_bvh_flatten)
    if (depth > f->depth) {
#pragma omp atomic write
        f->depth = depth;
    }
}

static void place_leaf(struct flattening *f, uint32_t at, const struct built *leaf, const struct place *place)
{
    struct node *node = &f->bvh->nodes[at];
    node->first = (uint32_t)place->triangle;
    node->count = leaf->count;
    memcpy(f->bvh->order + place->triangle, leaf->is.triangle, leaf->count * sizeof *leaf->is.triangle);
    note_depth(f, place->depth);
}

static uint32_t place_children(struct bvh *bvh, uint32_t at, const struct place *place)
{
    assert(place->node + 2 <= bvh->node_count);
    bvh->nodes[at].first = (uint32_t)place->node;
    bvh->nodes[at].count = 0;
    return (uint32_t)place->node;
}

struct leaf_list {
    const struct built **leaves;
    struct box *boxes;
    size_t count;
};

static void list_leaves(struct leaf_list *list, const struct built *from, const struct box *box)
{
    if (from->count != 0) {
        list->leaves[list->count] = from;
        list->boxes[list->count++] = *box;
        return;
    }
    for (int i = 0; i < 2; i++)
        list_leaves(list, from->is.inner.child[i], &from->is.inner.box[i]);
}

static void halve(struct flattening *f, uint32_t at, const struct leaf_list *list, size_t first, size_t count,
                  struct place place)
{
    struct bvh *bvh = f->bvh;
    if (count == 1) {
        bvh->nodes[at].box = list->boxes[first];
        place_leaf(f, at, list->leaves[first], &place);
        return;
    }
    const uint32_t child = place_children(bvh, at, &place);
    size_t triangles = 0;
    for (size_t i = 0; i < count / 2; i++)
        triangles += list->leaves[first + i]->triangles;
    const struct place below = place_of_children(&place);
    halve(f, child, list, first, count / 2, below);
    halve(f, child + 1, list, first + count / 2, count - count / 2, place_beside(&below, count / 2, triangles));
    bvh->nodes[at].box = box_join(&bvh->nodes[child].box, &bvh->nodes[child + 1].box);
}

static void fail_task(struct flattening *f, int status, const struct kiln_error *error)
{
#pragma omp critical(kiln_bvh_flatten)
    {
        f->status = status;
        f->error = *error;
    }
}

/* Flattens a subtree that is too deep: its leaves, in order, below a balanced tree. */
static void flatten_evenly(struct flattening *f, uint32_t at, const struct built *from, struct place place)
{
    struct leaf_list list = {NULL, NULL, 0};
    struct kiln_error error;
    const size_t count = from->leaves;
    int status = kiln_allocate(&list.leaves, count, sizeof *list.leaves, "the leaves of a deep BVH", &error);
    if (status == KILN_OK)
        status = kiln_allocate(&list.boxes, count, sizeof *list.boxes, "the leaves of a deep BVH", &error);
    if (status == KILN_OK) {
        list_leaves(&list, from, &f->bvh->nodes[at].box);
        halve(f, at, &list, 0, count, place);
    } else {
        fail_task(f, status, &error);
    }
    kiln_free(&list.leaves);
    kiln_free(&list.boxes);
}

/* Stores the descendants of node `at`, whose box is already there. */
static void flatten(struct flattening *f, uint32_t at, const struct built *from, struct place place)
{
    if (from->count != 0) {
        place_leaf(f, at, from, &place);
        return;
    }
    if (place.depth >= f->bvh->depth_limit) {
        flatten_evenly(f, at, from, place);
        return;
    }
    const struct built *first = from->is.inner.child[0], *second = from->is.inner.child[1];
    const uint32_t child = place_children(f->bvh, at, &place);
    const struct place below = place_of_children(&place),
                       beside = place_beside(&below, first->leaves, first->triangles);
    for (uint32_t i = 0; i < 2; i++)
        f->bvh->nodes[child + i].box = from->is.inner.box[i];
    if (first->triangles >= TASK_TRIANGLES) {
#pragma omp task firstprivate(f, child, first, below)
        flatten(f, child, first, below);
    } else {
        flatten(f, child, first, below);
    }
    flatten(f, child + 1, second, beside);
}

/* Flattens the tree, with balanced subtrees below its depth limit; while it is still too deep, repeats with a lower
 * limit. */
static int flatten_root(struct bvh *bvh, const struct built *root, const struct box *bounds, struct kiln_error *error)
{
    struct flattening f = {.bvh = bvh, .status = KILN_OK};
    bvh->node_count = 2 * (size_t)root->leaves - 1;
    bvh->order_count = root->triangles;
    const int status = allocate_untouched(&bvh->nodes, bvh->node_count, sizeof *bvh->nodes, "the BVH", error);
    if (status != KILN_OK)
        return status;
    bvh->nodes[0].box = *bounds;
    do {
        f.depth = 0;
#pragma omp parallel num_threads((int)bvh->threads)
#pragma omp single
        flatten(&f, 0, root, (struct place){.node = 1});
    } while (f.status == KILN_OK && f.depth > DEPTH_MOST && --bvh->depth_limit >= DEPTH_LIMIT_LEAST);
    return f.status == KILN_OK ? KILN_OK : kiln_fail(error, f.status, "%s", f.error.message);
}

/* ---- building ---- */

/* Makes a world without triangles, in which rays hit nothing. */
static int build_empty(struct bvh *bvh, struct kiln_error *error)
{
    const struct built stand_in = {.count = 1, .leaves = 1, .triangles = 1, .is.triangle = {KILN_GPU_NONE}};
    const struct box nowhere = {{0.0f, 0.0f, 0.0f}, {0.0f, 0.0f, 0.0f}};
    return flatten_root(bvh, &stand_in, &nowhere, error);
}

float bvh_margin(const struct kiln_geometry *g) { return fmaxf(KILN_GPU_BOX_MARGIN * g->extent, 1e-30f); }

static struct box fill_primitives(const struct kiln_geometry *g, struct RTCBuildPrimitive *primitives, uint32_t threads)
{
    const size_t count = kiln_geometry_hittable_count(g);
    const float margin = bvh_margin(g);
#pragma omp parallel for schedule(static) num_threads((int)threads)
    for (size_t i = 0; i < count; i++) {
        const size_t triangle = kiln_geometry_hittable(g, i);
        const struct box b = triangle_box(g, triangle, margin);
        primitives[i] = (struct RTCBuildPrimitive){b.lower[0], b.lower[1], b.lower[2], 0,
                                                   b.upper[0], b.upper[1], b.upper[2], (unsigned)triangle};
    }
    return (struct box){{g->bounds_min.x - margin, g->bounds_min.y - margin, g->bounds_min.z - margin},
                        {g->bounds_max.x + margin, g->bounds_max.y + margin, g->bounds_max.z + margin}};
}

static int build_with(struct bvh *bvh, RTCDevice device, struct RTCBuildPrimitive *primitives, struct kiln_error *error)
{
    const struct box bounds = fill_primitives(bvh->geometry, primitives, bvh->threads);
    struct RTCBuildArguments arguments = rtcDefaultBuildArguments();
    arguments.buildQuality = RTC_BUILD_QUALITY_MEDIUM;
    arguments.maxBranchingFactor = 2;
    arguments.maxDepth = 1024; /* flatten repairs too deep a tree, while the builder would fail */
    arguments.minLeafSize = 1;
    arguments.maxLeafSize = LEAF_MOST;
    arguments.bvh = rtcNewBVH(device);
    arguments.primitives = primitives;
    arguments.primitiveCount = arguments.primitiveArrayCapacity = kiln_geometry_hittable_count(bvh->geometry);
    arguments.createNode = create_node;
    arguments.setNodeChildren = set_children;
    arguments.setNodeBounds = set_bounds;
    arguments.createLeaf = create_leaf;
    const struct built *root = arguments.bvh != NULL ? rtcBuildBVH(&arguments) : NULL;
    const int status = root != NULL
                           ? flatten_root(bvh, root, &bounds, error)
                           : kiln_fail(error, KILN_SYSTEM,
                                       "Embree could not build the BVH of %zu triangles (its error %d): "
                                       "probably too little memory",
                                       kiln_geometry_hittable_count(bvh->geometry), (int)rtcGetDeviceError(device));
    if (arguments.bvh != NULL)
        rtcReleaseBVH(arguments.bvh);
    return status;
}

static int build(struct bvh *bvh, struct kiln_error *error)
{
    char config[32];
    (void)snprintf(config, sizeof config, "threads=%u", bvh->threads);
    RTCDevice device = rtcNewDevice(config);
    if (device == NULL)
        return kiln_fail(error, KILN_SYSTEM,
                         "Embree, which builds the BVH, could not create its device with '%s' (its error %d)", config,
                         (int)rtcGetDeviceError(NULL));
    struct RTCBuildPrimitive *primitives = NULL;
    int status = allocate_untouched(&primitives, kiln_geometry_hittable_count(bvh->geometry), sizeof *primitives,
                                    "the boxes of the triangles", error);
    if (status == KILN_OK)
        status = build_with(bvh, device, primitives, error);
    kiln_free(&primitives);
    rtcReleaseDevice(device);
    return status;
}

/* One without a tree. */
static int begin(struct bvh **bvh, const struct kiln_geometry *geometry, const struct bvh_params *params,
                 struct kiln_error *error)
{
    struct bvh *b = NULL;
    *bvh = NULL;
    if (geometry->triangle_count > KILN_GPU_LEAF_FIRST)
        return kiln_fail(error, KILN_BAD_INPUT,
                         "%zu triangles are more than a BVH for the device can hold (%u): bake parts of the scene",
                         geometry->triangle_count, KILN_GPU_LEAF_FIRST);
    const int status = kiln_allocate(&b, 1, sizeof *b, "the BVH", error);
    if (status != KILN_OK)
        return status;
    *bvh = b;
    b->geometry = geometry;
    b->depth_limit = params->depth_limit != 0 ? params->depth_limit : DEPTH_LIMIT;
    b->threads = params->threads != 0 ? params->threads : (uint32_t)omp_get_num_procs();
    return allocate_untouched(&b->order, kiln_geometry_hittable_count(geometry) + 1, sizeof *b->order,
                              "the BVH's order of triangles", error);
}

int bvh_create(struct bvh **bvh, const struct kiln_geometry *geometry, const struct bvh_params *params,
               struct kiln_error *error)
{
    int status = begin(bvh, geometry, params, error);
    if (status == KILN_OK)
        status = kiln_geometry_hittable_count(geometry) == 0 ? build_empty(*bvh, error) : build(*bvh, error);
    if (status != KILN_OK)
        bvh_destroy(bvh);
    return status;
}

/* ---- from the device's tree ---- */

/* Lists the few triangles below a node; returns their number. */
static uint32_t list_triangles(const struct kiln_gpu_bvh_node *nodes, uint32_t at, uint32_t triangles[LEAF_MOST])
{
    if (nodes[at].second == KILN_GPU_NONE) {
        triangles[0] = nodes[at].first;
        return 1;
    }
    const uint32_t count = list_triangles(nodes, nodes[at].first, triangles);
    return count + list_triangles(nodes, nodes[at].second, triangles + count);
}

static struct box box_of(const struct kiln_gpu_bvh_node *node)
{
    return (struct box){{node->lower[0], node->lower[1], node->lower[2]},
                        {node->upper[0], node->upper[1], node->upper[2]}};
}

/* Children stand before their parents. */
static void take_node(const struct kiln_gpu_bvh_node *nodes, const struct kiln_gpu_bvh_subtree *subtrees, uint32_t at,
                      struct built *tree)
{
    struct built *to = &tree[at];
    to->triangles = subtrees[at].triangles & ~KILN_GPU_LEAF;
    to->count = (subtrees[at].triangles & KILN_GPU_LEAF) != 0 ? to->triangles : 0;
    to->leaves = 1;
    if (to->count != 0) {
        (void)list_triangles(nodes, at, to->is.triangle);
        return;
    }
    const uint32_t child[2] = {nodes[at].first, nodes[at].second};
    for (int i = 0; i < 2; i++) {
        to->is.inner.child[i] = &tree[child[i]];
        to->is.inner.box[i] = box_of(&nodes[child[i]]);
    }
    to->leaves = tree[child[0]].leaves + tree[child[1]].leaves;
}

int bvh_create_of(struct bvh **bvh, const struct kiln_geometry *geometry, const struct bvh_params *params,
                  const struct kiln_gpu_bvh_node *nodes, const struct kiln_gpu_bvh_subtree *subtrees,
                  struct kiln_error *error)
{
    const size_t count = 2 * kiln_geometry_hittable_count(geometry) - 1;
    struct built *tree = NULL;
    int status = begin(bvh, geometry, params, error);
    if (status == KILN_OK)
        status = allocate_untouched(&tree, count, sizeof *tree, "the device's BVH", error);
    for (size_t i = 0; i < count && status == KILN_OK; i++)
        take_node(nodes, subtrees, (uint32_t)i, tree);
    const struct box bounds = box_of(&nodes[count - 1]);
    if (status == KILN_OK)
        status = flatten_root(*bvh, &tree[count - 1], &bounds, error);
    if (status == KILN_OK)
        (*bvh)->of_device = true;
    kiln_free(&tree);
    if (status != KILN_OK)
        bvh_destroy(bvh);
    return status;
}

bool bvh_is_of_device(const struct bvh *bvh) { return bvh != NULL && bvh->of_device; }

void bvh_destroy(struct bvh **bvh)
{
    if (*bvh == NULL)
        return;
    kiln_free(&(*bvh)->nodes);
    kiln_free(&(*bvh)->order);
    kiln_free(bvh);
}

/* ---- layouts ---- */

/* Size of the layout below a tree node that is also a node of the layout. */
struct extent {
    uint32_t nodes;     /* below it */
    uint32_t triangles; /* of all leaves below it */
    uint32_t stack;     /* that a walk from here needs */
};

struct export
{
    const struct bvh *bvh;
    struct bvh_layout *layout;
    uint32_t kind, width;
    struct extent *extents; /* per node of the tree, for those that are nodes of the layout */
};

/* The children of one node of a layout, by slot. */
struct family {
    uint32_t member[WIDTH_MOST]; /* of the flat tree; KILN_GPU_NONE: nothing */
    uint32_t place[WIDTH_MOST];  /* index of its node in the layout, or of a leaf's first triangle there */
};

/* Opens the child with the largest box until there are `width` children, or all are leaves. */
static uint32_t gather(const struct bvh *bvh, uint32_t from, uint32_t width, uint32_t children[WIDTH_MOST])
{
    uint32_t count = 1;
    children[0] = from;
    while (count < width) {
        uint32_t widest = KILN_GPU_NONE;
        double most = -1.0;
        for (uint32_t i = 0; i < count; i++) {
            const struct node *node = &bvh->nodes[children[i]];
            const double area = node->count == 0 ? box_area(&node->box) : -1.0;
            if (area > most) {
                most = area;
                widest = i;
            }
        }
        if (widest == KILN_GPU_NONE)
            break;
        const uint32_t first = bvh->nodes[children[widest]].first;
        children[widest] = first;
        children[count++] = first + 1;
    }
    return count;
}

/* Twice the distance between the middles of a box and its parent, along the diagonal of a slot. */
static double along_diagonal(const struct box *parent, const struct box *box, uint32_t slot)
{
    double sum = 0.0;
    for (uint32_t k = 0; k < 3; k++) {
        const double d =
            ((double)box->lower[k] + (double)box->upper[k]) - ((double)parent->lower[k] + (double)parent->upper[k]);
        sum += (slot >> (2 - k) & 1u) != 0 ? -d : d;
    }
    return sum;
}

/* Assigns children to slots by octant, so that a ray meets them roughly in the order slot XOR its own octant (Ylitie et
 * al. 2017, section 3.3; here the assignment is greedy). */
static void arrange(const struct bvh *bvh, uint32_t parent, const uint32_t *children, uint32_t count,
                    struct family *family)
{
    double cost[WIDTH_MOST][WIDTH_MOST];
    bool placed[WIDTH_MOST] = {false};
    for (uint32_t i = 0; i < count; i++)
        for (uint32_t slot = 0; slot < WIDTH_MOST; slot++)
            cost[i][slot] = along_diagonal(&bvh->nodes[parent].box, &bvh->nodes[children[i]].box, slot);
    for (uint32_t round = 0; round < count; round++) {
        uint32_t best_child = KILN_GPU_NONE, best_slot = 0;
        for (uint32_t i = 0; i < count; i++)
            for (uint32_t slot = 0; slot < WIDTH_MOST && !placed[i]; slot++)
                if (family->member[slot] == KILN_GPU_NONE &&
                    (best_child == KILN_GPU_NONE || cost[i][slot] < cost[best_child][best_slot])) {
                    best_child = i;
                    best_slot = slot;
                }
        family->member[best_slot] = children[best_child];
        placed[best_child] = true;
    }
}

static void place_triangle(const struct bvh_layout *layout, size_t at, const struct kiln_geometry *g, uint32_t number)
{
    struct kiln_vec3 c[3] = {{0.0f, 0.0f, 0.0f}, {0.0f, 0.0f, 0.0f}, {0.0f, 0.0f, 0.0f}};
    if (number != KILN_GPU_NONE)
        kiln_geometry_corners(g, number, c);
    layout->triangles[at] = (struct kiln_gpu_triangle){{c[0].x, c[0].y, c[0].z}, number, {c[1].x, c[1].y, c[1].z}, 0,
                                                       {c[2].x, c[2].y, c[2].z}, 0};
}

/* First free node and triangle for the descendants of a node of the layout. */
struct start {
    uint32_t node, triangle;
};

/* Assigns places to the members, adjacent nodes, and stores all triangles of the leaves; advances `start`. */
static void settle(const struct export *e, struct family *family, struct start *start)
{
    for (uint32_t i = 0; i < WIDTH_MOST; i++) {
        if (family->member[i] == KILN_GPU_NONE)
            continue;
        const struct node *node = &e->bvh->nodes[family->member[i]];
        family->place[i] = node->count == 0 ? start->node++ : start->triangle;
        for (uint32_t j = 0; j < node->count; j++)
            place_triangle(e->layout, start->triangle++, e->bvh->geometry, e->bvh->order[node->first + j]);
    }
}

static uint32_t child_code(const struct bvh *bvh, const struct family *family, uint32_t i)
{
    const uint32_t count = bvh->nodes[family->member[i]].count;
    return count == 0 ? family->place[i] : KILN_GPU_LEAF | (count - 1u) << KILN_GPU_LEAF_COUNT_SHIFT | family->place[i];
}

static void encode4(const struct bvh *bvh, const struct family *family, struct kiln_gpu_bvh4_node *to)
{
    const float nowhere = 3.0e38f;
    *to = (struct kiln_gpu_bvh4_node){.unused = {0, 0, 0, 0}};
    for (uint32_t i = 0; i < 4; i++) {
        const bool there = family->member[i] != KILN_GPU_NONE;
        const struct box *box = there ? &bvh->nodes[family->member[i]].box : NULL;
        for (uint32_t k = 0; k < 3; k++) {
            to->bounds[2 * k][i] = there ? box->lower[k] : nowhere;
            to->bounds[2 * k + 1][i] = there ? box->upper[k] : -nowhere;
        }
        to->child[i] = there ? child_code(bvh, family, i) : KILN_GPU_NONE;
    }
}

static void set_byte(uint32_t words[2], uint32_t i, uint32_t value) { words[i / 4] |= value << 8 * (i % 4); }

/* Exponent of the smallest power-of-two step with which 255 steps cover `length`. */
static int step_exponent(double length)
{
    int exponent;
    const double fraction = frexp(length / 255.0, &exponent); /* in [0.5, 1): 2^exponent is enough */
    exponent -= fraction == 0.5 ? 1 : 0;
    return length > 0.0 && exponent > -126 ? exponent : -126;
}

static void encode8_bounds(const struct bvh *bvh, const struct family *family, uint32_t k, int exponent,
                           struct kiln_gpu_bvh8_node *to)
{
    for (uint32_t i = 0; i < 8; i++) {
        if (family->member[i] == KILN_GPU_NONE)
            continue;
        const struct box *box = &bvh->nodes[family->member[i]].box;
        const double origin = (double)to->origin[k];
        const double lower = floor(ldexp((double)box->lower[k] - origin, -exponent)),
                     upper = ceil(ldexp((double)box->upper[k] - origin, -exponent));
        assert(lower >= 0.0 && upper <= 255.0);
        set_byte(to->bounds[k], i, (uint32_t)lower);
        set_byte(to->bounds[3 + k], i, (uint32_t)upper);
    }
}

static void encode8(const struct bvh *bvh, const struct family *family, uint32_t parent, struct kiln_gpu_bvh8_node *to)
{
    const struct box *whole = &bvh->nodes[parent].box;
    *to = (struct kiln_gpu_bvh8_node){.origin = {whole->lower[0], whole->lower[1], whole->lower[2]}};
    for (uint32_t k = 0; k < 3; k++) {
        const int exponent = step_exponent((double)whole->upper[k] - (double)whole->lower[k]);
        to->exponents_inner |= (uint32_t)(exponent + 127) << 8 * k;
        encode8_bounds(bvh, family, k, exponent, to);
    }
    bool any_node = false, any_leaf = false;
    for (uint32_t i = 0; i < 8; i++) {
        if (family->member[i] == KILN_GPU_NONE)
            continue;
        const uint32_t count = bvh->nodes[family->member[i]].count;
        if (count == 0) {
            to->node_first = any_node ? to->node_first : family->place[i];
            to->exponents_inner |= 1u << (24 + i);
            set_byte(to->meta, i, 1u << 5 | (24 + i));
            any_node = true;
        } else {
            to->triangle_first = any_leaf ? to->triangle_first : family->place[i];
            set_byte(to->meta, i, ((1u << count) - 1u) << 5 | (family->place[i] - to->triangle_first));
            any_leaf = true;
        }
    }
}

/* Returns the stack size of a traversal below a node whose deepest child needs `deepest`. */
static uint32_t stack_of(const struct export *e, uint32_t children, uint32_t deepest, bool any_node)
{
    if (e->kind == KILN_TRAVERSAL_EIGHT)
        return any_node ? deepest + 1 : 0;
    return deepest + children - 1;
}

/* The triangles below a node of the tree: from those of its first leaf to those of its last. */
static uint32_t triangles_below(const struct bvh *bvh, uint32_t node)
{
    uint32_t first = node, last = node;
    while (bvh->nodes[first].count == 0)
        first = bvh->nodes[first].first;
    while (bvh->nodes[last].count == 0)
        last = bvh->nodes[last].first + 1;
    return bvh->nodes[last].first + bvh->nodes[last].count - bvh->nodes[first].first;
}

static void measure(const struct export *e, uint32_t from);

/* Measures the children that are nodes, each perhaps as a task. */
static void measure_children(const struct export *e, const uint32_t *children, uint32_t count)
{
#pragma omp taskgroup
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t child = children[i];
        if (e->bvh->nodes[child].count == 0) {
#pragma omp task firstprivate(e, child)
            measure(e, child);
        }
    }
}

/* Computes the extents of node `from` of the tree, and of all layout nodes below. */
static void measure(const struct export *e, uint32_t from)
{
    const struct bvh *bvh = e->bvh;
    uint32_t children[WIDTH_MOST], deepest = 0;
    bool any_node = false;
    struct extent *own = &e->extents[from];
    const uint32_t count = gather(bvh, from, e->width, children);
    *own = (struct extent){.triangles = triangles_below(bvh, from)};
    const bool is_large = own->triangles >= TASK_TRIANGLES;
    if (is_large)
        measure_children(e, children, count);
    for (uint32_t i = 0; i < count; i++) {
        if (bvh->nodes[children[i]].count != 0)
            continue;
        if (!is_large)
            measure(e, children[i]);
        const struct extent *below = &e->extents[children[i]];
        own->nodes += 1 + below->nodes;
        deepest = below->stack > deepest ? below->stack : deepest;
        any_node = true;
    }
    own->stack = stack_of(e, count > 1 ? count : 2, deepest, any_node);
}

static void encode(const struct export *e, const struct family *family, uint32_t from, uint32_t at)
{
    if (e->kind == KILN_TRAVERSAL_FOUR)
        encode4(e->bvh, family, (struct kiln_gpu_bvh4_node *)e->layout->nodes + at);
    else
        encode8(e->bvh, family, from, (struct kiln_gpu_bvh8_node *)e->layout->nodes + at);
}

/* Fills the layout's node `at` from node `from` of the tree, and all below it, from `start` on. */
static void fill(const struct export *e, uint32_t from, uint32_t at, struct start start)
{
    uint32_t children[WIDTH_MOST];
    struct family family;
    const uint32_t count = gather(e->bvh, from, e->width, children);
    memset(&family, 0xff, sizeof family);
    if (e->kind == KILN_TRAVERSAL_EIGHT)
        arrange(e->bvh, from, children, count, &family);
    else
        memcpy(family.member, children, count * sizeof *children);
    settle(e, &family, &start);
    encode(e, &family, from, at);
    for (uint32_t i = 0; i < WIDTH_MOST; i++) {
        const uint32_t child = family.member[i], place = family.place[i];
        if (child == KILN_GPU_NONE || e->bvh->nodes[child].count != 0)
            continue;
        if (e->extents[child].triangles >= TASK_TRIANGLES) {
#pragma omp task firstprivate(e, child, place, start)
            fill(e, child, place, start);
        } else {
            fill(e, child, place, start);
        }
        start.node += e->extents[child].nodes;
        start.triangle += e->extents[child].triangles;
    }
}

/* Writes the nodes and triangles of the layout, by all threads: first counts how many come before each, then stores
 * them. */
static int fill_all(struct export *e, struct kiln_error *error)
{
    struct bvh_layout *layout = e->layout;
    int status = allocate_untouched(&e->extents, e->bvh->node_count, sizeof *e->extents, "a layout of the BVH", error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel num_threads((int)e->bvh->threads)
#pragma omp single
    measure(e, 0);
    layout->node_count = 1 + e->extents[0].nodes;
    layout->stack = e->extents[0].stack;
    status = allocate_untouched(&layout->nodes, layout->node_count, layout->node_size, "a layout of the BVH", error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel num_threads((int)e->bvh->threads)
#pragma omp single
    fill(e, 0, 0, (struct start){.node = 1});
    return KILN_OK;
}

int bvh_layout_create(struct bvh_layout *layout, const struct bvh *bvh, uint32_t traversal, struct kiln_error *error)
{
    const bool four = traversal == KILN_TRAVERSAL_FOUR;
    struct export e = {.bvh = bvh, .layout = layout, .kind = traversal, .width = four ? 4 : 8};
    *layout =
        (struct bvh_layout){.node_size = four ? sizeof(struct kiln_gpu_bvh4_node) : sizeof(struct kiln_gpu_bvh8_node)};
    assert(traversal <= KILN_TRAVERSAL_EIGHT);
    int status = allocate_untouched(&layout->triangles, bvh->order_count, sizeof *layout->triangles,
                                    "the triangles of the BVH", error);
    layout->triangle_count = status == KILN_OK ? bvh->order_count : 0;
    if (status == KILN_OK)
        status = fill_all(&e, error);
    kiln_free(&e.extents);
    layout->stack += four ? 1 : 0; /* the entry that ends the walk */
    assert(layout->stack <= (four ? KILN_GPU_STACK4 : KILN_GPU_STACK8));
    if (status != KILN_OK)
        bvh_layout_free(layout);
    return status;
}

void bvh_layout_free(struct bvh_layout *layout)
{
    kiln_free(&layout->nodes);
    kiln_free(&layout->triangles);
    *layout = (struct bvh_layout){NULL, 0, 0, NULL, 0, 0};
}
