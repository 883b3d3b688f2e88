#include "worker/backend/vulkan/bvh.h"

#include <assert.h>
#include <embree3/rtcore.h>
#include <math.h>
#include <omp.h>
#include <stdio.h>
#include <string.h>

#include "worker/base/memory.h"

enum { LEAF_MOST = 3 /* as many as a child of struct kiln_gpu_node8 tells */, DEPTH_LIMIT = 40, WIDTH_MOST = 8 };

struct box {
    float lower[3], upper[3];
};

/* The tree, flat. Children of a node stand side by side. */
struct node {
    struct box box;
    uint32_t first; /* first child, or first of a leaf's triangles in `order` */
    uint32_t count; /* triangles of a leaf; 0: a node with two children */
};

struct bvh {
    const struct kiln_geometry *geometry;
    struct node *nodes; /* the root first */
    size_t node_count, node_capacity;
    uint32_t *order; /* world triangles, leaf by leaf */
    size_t order_count;
    uint32_t depth_limit, depth;
};

/* ---- what Embree's builder calls; memory is the builder's ---- */

struct built {
    uint32_t count; /* of a leaf; 0: two children */
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

static void set_children(void *pointer, void **children, unsigned int child_count, void *user)
{
    (void)user;
    struct built *node = pointer;
    for (unsigned i = 0; i < child_count; i++)
        node->is.inner.child[i] = children[i];
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
    leaf->count = (uint32_t)count;
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

static void place_leaf(struct bvh *bvh, uint32_t at, const struct built *leaf)
{
    bvh->nodes[at].first = (uint32_t)bvh->order_count;
    bvh->nodes[at].count = leaf->count;
    for (uint32_t i = 0; i < leaf->count; i++)
        bvh->order[bvh->order_count++] = leaf->is.triangle[i];
}

static uint32_t place_children(struct bvh *bvh, uint32_t at)
{
    assert(bvh->node_count + 2 <= bvh->node_capacity);
    const uint32_t first = (uint32_t)bvh->node_count;
    bvh->node_count += 2;
    bvh->nodes[at].first = first;
    bvh->nodes[at].count = 0;
    return first;
}

struct leaf_list {
    const struct built **leaves;
    struct box *boxes;
    size_t count;
};

static size_t count_leaves(const struct built *from)
{
    return from->count != 0 ? 1 : count_leaves(from->is.inner.child[0]) + count_leaves(from->is.inner.child[1]);
}

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

static void halve(struct bvh *bvh, uint32_t at, const struct leaf_list *list, size_t first, size_t count,
                  uint32_t depth)
{
    bvh->depth = depth > bvh->depth ? depth : bvh->depth;
    if (count == 1) {
        bvh->nodes[at].box = list->boxes[first];
        place_leaf(bvh, at, list->leaves[first]);
        return;
    }
    const uint32_t child = place_children(bvh, at);
    halve(bvh, child, list, first, count / 2, depth + 1);
    halve(bvh, child + 1, list, first + count / 2, count - count / 2, depth + 1);
    bvh->nodes[at].box = box_join(&bvh->nodes[child].box, &bvh->nodes[child + 1].box);
}

/* A subtree that goes too deep: its leaves, in their order, under a tree as flat as can be. */
static int flatten_evenly(struct bvh *bvh, uint32_t at, const struct built *from, uint32_t depth,
                          struct kiln_error *error)
{
    struct leaf_list list = {NULL, NULL, 0};
    const size_t count = count_leaves(from);
    int status = kiln_allocate(&list.leaves, count, sizeof *list.leaves, "the leaves of a deep BVH", error);
    if (status == KILN_OK)
        status = kiln_allocate(&list.boxes, count, sizeof *list.boxes, "the leaves of a deep BVH", error);
    if (status == KILN_OK) {
        list_leaves(&list, from, &bvh->nodes[at].box);
        halve(bvh, at, &list, 0, count, depth);
    }
    kiln_free(&list.leaves);
    kiln_free(&list.boxes);
    return status;
}

static int flatten(struct bvh *bvh, uint32_t at, const struct built *from, uint32_t depth, struct kiln_error *error)
{
    bvh->depth = depth > bvh->depth ? depth : bvh->depth;
    if (from->count != 0) {
        place_leaf(bvh, at, from);
        return KILN_OK;
    }
    if (depth >= bvh->depth_limit)
        return flatten_evenly(bvh, at, from, depth, error);
    const uint32_t child = place_children(bvh, at);
    int status = KILN_OK;
    for (uint32_t i = 0; i < 2 && status == KILN_OK; i++) {
        bvh->nodes[child + i].box = from->is.inner.box[i];
        status = flatten(bvh, child + i, from->is.inner.child[i], depth + 1, error);
    }
    return status;
}

static int flatten_root(struct bvh *bvh, const struct built *root, const struct box *bounds, struct kiln_error *error)
{
    bvh->node_capacity = 2 * count_leaves(root) - 1;
    int status = kiln_allocate(&bvh->nodes, bvh->node_capacity, sizeof *bvh->nodes, "the BVH", error);
    if (status != KILN_OK)
        return status;
    bvh->node_count = 1;
    bvh->nodes[0].box = *bounds;
    return flatten(bvh, 0, root, 0, error);
}

/* ---- building ---- */

/* A world without triangles is one that nothing meets. */
static int build_empty(struct bvh *bvh, struct kiln_error *error)
{
    const struct built stand_in = {.count = 1, .is.triangle = {KILN_GPU_NONE}};
    const struct box nowhere = {{0.0f, 0.0f, 0.0f}, {0.0f, 0.0f, 0.0f}};
    return flatten_root(bvh, &stand_in, &nowhere, error);
}

static float margin_of(const struct kiln_geometry *g) { return fmaxf(KILN_GPU_BOX_MARGIN * g->extent, 1e-30f); }

static struct box fill_primitives(const struct kiln_geometry *g, struct RTCBuildPrimitive *primitives, uint32_t threads)
{
    const size_t count = kiln_geometry_hittable_count(g);
    const float margin = margin_of(g);
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

static int build_with(struct bvh *bvh, RTCDevice device, struct RTCBuildPrimitive *primitives, uint32_t threads,
                      struct kiln_error *error)
{
    const struct box bounds = fill_primitives(bvh->geometry, primitives, threads);
    struct RTCBuildArguments arguments = rtcDefaultBuildArguments();
    arguments.buildQuality = RTC_BUILD_QUALITY_MEDIUM;
    arguments.maxBranchingFactor = 2;
    arguments.maxDepth = 1024; /* too deep a tree is mended in flatten; the builder would fail */
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

static int build(struct bvh *bvh, uint32_t threads, struct kiln_error *error)
{
    char config[32];
    (void)snprintf(config, sizeof config, "threads=%u", threads);
    RTCDevice device = rtcNewDevice(config);
    if (device == NULL)
        return kiln_fail(error, KILN_SYSTEM,
                         "Embree, which builds the BVH, could not create its device with '%s' (its error %d)", config,
                         (int)rtcGetDeviceError(NULL));
    struct RTCBuildPrimitive *primitives = NULL;
    int status = kiln_allocate(&primitives, kiln_geometry_hittable_count(bvh->geometry), sizeof *primitives,
                               "the boxes of the triangles", error);
    if (status == KILN_OK)
        status = build_with(bvh, device, primitives, threads, error);
    kiln_free(&primitives);
    rtcReleaseDevice(device);
    return status;
}

int bvh_create(struct bvh **bvh, const struct kiln_geometry *geometry, const struct bvh_params *params,
               struct kiln_error *error)
{
    *bvh = NULL;
    if (geometry->triangle_count > KILN_GPU_LEAF_FIRST)
        return kiln_fail(error, KILN_BAD_INPUT,
                         "%zu triangles are more than a BVH for the device can hold (%u): bake parts of the scene",
                         geometry->triangle_count, KILN_GPU_LEAF_FIRST);
    struct bvh *b = NULL;
    int status = kiln_allocate(&b, 1, sizeof *b, "the BVH", error);
    if (status != KILN_OK)
        return status;
    b->geometry = geometry;
    b->depth_limit = params->depth_limit != 0 ? params->depth_limit : DEPTH_LIMIT;
    status = kiln_allocate(&b->order, kiln_geometry_hittable_count(geometry) + 1, sizeof *b->order,
                           "the BVH's order of triangles", error);
    if (status == KILN_OK)
        status = kiln_geometry_hittable_count(geometry) == 0
                     ? build_empty(b, error)
                     : build(b, params->threads != 0 ? params->threads : (uint32_t)omp_get_num_procs(), error);
    if (status != KILN_OK)
        bvh_destroy(&b);
    *bvh = b;
    return status;
}

void bvh_destroy(struct bvh **bvh)
{
    if (*bvh == NULL)
        return;
    kiln_free(&(*bvh)->nodes);
    kiln_free(&(*bvh)->order);
    kiln_free(bvh);
}

/* ---- layouts ---- */

struct export
{
    const struct bvh *bvh;
    struct bvh_layout *layout;
    size_t node_capacity;
    uint32_t kind, width;
    struct kiln_error *error;
};

/* The children of one node of a layout, by slot. */
struct family {
    uint32_t member[WIDTH_MOST]; /* of the flat tree; KILN_GPU_NONE: nothing */
    uint32_t place[WIDTH_MOST];  /* index of its node in the layout, or of a leaf's first triangle there */
};

/* Opens the largest box again and again until `width` children are there or all are leaves. */
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

/* Twice the distance of a box's middle from the parent's, along the diagonal that belongs to a slot. */
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

/* Slots by octant, so that a ray meets children about in the order slot XOR its own octant (Ylitie et al. 2017,
 * section 3.3; the assignment is greedy here). */
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

static void place_triangle(struct bvh_layout *layout, const struct kiln_geometry *g, uint32_t number)
{
    struct kiln_vec3 c[3] = {{0.0f, 0.0f, 0.0f}, {0.0f, 0.0f, 0.0f}, {0.0f, 0.0f, 0.0f}};
    if (number != KILN_GPU_NONE)
        kiln_geometry_corners(g, number, c);
    layout->triangles[layout->triangle_count++] = (struct kiln_gpu_triangle){
        {c[0].x, c[0].y, c[0].z}, number, {c[1].x, c[1].y, c[1].z}, 0, {c[2].x, c[2].y, c[2].z}, 0};
}

/* Gives the members their places: nodes side by side, and all triangles of the leaves. */
static int settle(struct export *e, struct family *family)
{
    struct bvh_layout *layout = e->layout;
    for (uint32_t i = 0; i < WIDTH_MOST; i++) {
        if (family->member[i] == KILN_GPU_NONE)
            continue;
        const struct node *node = &e->bvh->nodes[family->member[i]];
        family->place[i] = node->count == 0 ? (uint32_t)layout->node_count++ : (uint32_t)layout->triangle_count;
        for (uint32_t j = 0; j < node->count; j++)
            place_triangle(layout, e->bvh->geometry, e->bvh->order[node->first + j]);
    }
    return kiln_grow(&layout->nodes, &e->node_capacity, layout->node_count, layout->node_size, "a layout of the BVH",
                     e->error);
}

static uint32_t child_code(const struct bvh *bvh, const struct family *family, uint32_t i)
{
    const uint32_t count = bvh->nodes[family->member[i]].count;
    return count == 0 ? family->place[i] : KILN_GPU_LEAF | (count - 1u) << KILN_GPU_LEAF_COUNT_SHIFT | family->place[i];
}

static void encode2(const struct bvh *bvh, const struct family *family, struct kiln_gpu_node2 *to)
{
    *to = (struct kiln_gpu_node2){.unused = {0, 0}};
    for (uint32_t i = 0; i < 2; i++) {
        const uint32_t from = family->member[i] != KILN_GPU_NONE ? i : 0; /* an only child, a leaf, is there twice */
        const struct box *box = &bvh->nodes[family->member[from]].box;
        const float xy[4] = {box->lower[0], box->upper[0], box->lower[1], box->upper[1]};
        memcpy(to->xy[i], xy, sizeof xy);
        to->z[2 * i] = box->lower[2];
        to->z[2 * i + 1] = box->upper[2];
        to->child[i] = child_code(bvh, family, from);
    }
}

static void encode4(const struct bvh *bvh, const struct family *family, struct kiln_gpu_node4 *to)
{
    const float nowhere = 3.0e38f;
    *to = (struct kiln_gpu_node4){.unused = {0, 0, 0, 0}};
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

/* Exponent of the smallest step, a power of two, of which 255 reach over `length`. */
static int step_exponent(double length)
{
    int exponent;
    const double fraction = frexp(length / 255.0, &exponent); /* in [0.5, 1): 2^exponent is enough */
    exponent -= fraction == 0.5 ? 1 : 0;
    return length > 0.0 && exponent > -126 ? exponent : -126;
}

static void encode8_bounds(const struct bvh *bvh, const struct family *family, uint32_t k, int exponent,
                           struct kiln_gpu_node8 *to)
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

static void encode8(const struct bvh *bvh, const struct family *family, uint32_t parent, struct kiln_gpu_node8 *to)
{
    const struct box *whole = &bvh->nodes[parent].box;
    *to = (struct kiln_gpu_node8){.origin = {whole->lower[0], whole->lower[1], whole->lower[2]}};
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

/* What the stack of a walk must hold below a node whose deepest child needs `deepest`. */
static uint32_t stack_of(const struct export *e, uint32_t children, uint32_t deepest, bool any_node)
{
    if (e->kind == KILN_TRAVERSAL_EIGHT)
        return any_node ? deepest + 1 : 0;
    return deepest + children - 1;
}

/* Fills the layout's node `at` from node `from` of the tree, and all below; `stack` gets what a walk from here needs.
 */
static int fill(struct export *e, uint32_t from, uint32_t at, uint32_t *stack)
{
    uint32_t children[WIDTH_MOST];
    struct family family;
    const uint32_t count = gather(e->bvh, from, e->width, children);
    memset(&family, 0xff, sizeof family);
    if (e->kind == KILN_TRAVERSAL_EIGHT)
        arrange(e->bvh, from, children, count, &family);
    else
        memcpy(family.member, children, count * sizeof *children);
    int status = settle(e, &family);
    if (status != KILN_OK)
        return status;
    if (e->kind == KILN_TRAVERSAL_BINARY)
        encode2(e->bvh, &family, (struct kiln_gpu_node2 *)e->layout->nodes + at);
    else if (e->kind == KILN_TRAVERSAL_FOUR)
        encode4(e->bvh, &family, (struct kiln_gpu_node4 *)e->layout->nodes + at);
    else
        encode8(e->bvh, &family, from, (struct kiln_gpu_node8 *)e->layout->nodes + at);
    uint32_t deepest = 0;
    bool any_node = false;
    for (uint32_t i = 0; i < WIDTH_MOST && status == KILN_OK; i++) {
        if (family.member[i] == KILN_GPU_NONE || e->bvh->nodes[family.member[i]].count != 0)
            continue;
        uint32_t need = 0;
        status = fill(e, family.member[i], family.place[i], &need);
        deepest = need > deepest ? need : deepest;
        any_node = true;
    }
    *stack = stack_of(e, count > 1 ? count : 2, deepest, any_node);
    return status;
}

static int export_tree(struct bvh_layout *layout, const struct bvh *bvh, uint32_t kind, struct kiln_error *error)
{
    const uint32_t width[] = {0, 2, 4, 8}, room[] = {0, KILN_GPU_STACK2, KILN_GPU_STACK4, KILN_GPU_STACK8};
    const size_t size[] = {0, sizeof(struct kiln_gpu_node2), sizeof(struct kiln_gpu_node4),
                           sizeof(struct kiln_gpu_node8)};
    struct export e = {.bvh = bvh, .layout = layout, .kind = kind, .width = width[kind], .error = error};
    layout->node_size = size[kind];
    layout->node_count = 1;
    int status = kiln_grow(&layout->nodes, &e.node_capacity, 1 + bvh->node_count / width[kind], layout->node_size,
                           "a layout of the BVH", error);
    if (status == KILN_OK)
        status = fill(&e, 0, 0, &layout->stack);
    layout->stack += kind == KILN_TRAVERSAL_EIGHT ? 0 : 1; /* the entry that ends the walk */
    if (status == KILN_OK && layout->stack > room[kind])
        status =
            kiln_fail(error, KILN_BAD_INPUT,
                      "the %u-wide layout of the BVH needs a stack of %u entries and shaders have %u: use --traversal "
                      "binary",
                      width[kind], layout->stack, room[kind]);
    return status;
}

int bvh_layout_create(struct bvh_layout *layout, const struct bvh *bvh, uint32_t traversal, struct kiln_error *error)
{
    *layout = (struct bvh_layout){NULL, 0, 0, NULL, 0, 0};
    assert(traversal <= KILN_TRAVERSAL_EIGHT);
    int status = kiln_allocate(&layout->triangles, bvh->order_count, sizeof *layout->triangles,
                               "the triangles of the BVH", error);
    if (status == KILN_OK && traversal != KILN_TRAVERSAL_BRUTE)
        status = export_tree(layout, bvh, traversal, error);
    else if (status == KILN_OK)
        for (size_t i = 0; i < bvh->order_count; i++)
            place_triangle(layout, bvh->geometry,
                           kiln_geometry_hittable_count(bvh->geometry) != 0
                               ? (uint32_t)kiln_geometry_hittable(bvh->geometry, i)
                               : KILN_GPU_NONE);
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

/* Whether any walk of the layout fits the stack, without making it: the tree's depth bounds it. */
static bool surely_fits(const struct bvh *bvh, uint32_t kind)
{
    return kind == KILN_TRAVERSAL_EIGHT ? bvh->depth <= KILN_GPU_STACK8
                                        : kind != KILN_TRAVERSAL_FOUR || 3 * bvh->depth < KILN_GPU_STACK4;
}

size_t bvh_candidates(const struct bvh *bvh, bool software, uint32_t *candidates, size_t room)
{
    /* On an H200 four-wide was the fastest from 46 triangles to 4 million (binary 5 to 10 % behind, compressed
     * eight-wide 10 to 55 %, all triangles tested 45 % behind at 46); on Mesa's software device eight-wide was twice as
     * fast as any other, and has the shortest loops. Exporting a layout of millions of triangles takes longer than it
     * may win. */
    const uint32_t real[] = {KILN_TRAVERSAL_FOUR, KILN_TRAVERSAL_BINARY, KILN_TRAVERSAL_EIGHT};
    const uint32_t played[] = {KILN_TRAVERSAL_EIGHT, KILN_TRAVERSAL_BINARY};
    const uint32_t *from = software ? played : real;
    const size_t from_count = software || bvh->order_count > 1u << 20 ? 2 : 3;
    size_t count = 0;
    for (size_t i = 0; i < from_count && count < room; i++)
        if (surely_fits(bvh, from[i]))
            candidates[count++] = from[i];
    return count;
}
