#include "coordinator/integrate/patches/link_build.h"

#include <math.h>
#include <stdlib.h>

#include "worker/base/arena.h"
#include "worker/base/memory.h"

enum {
    AXES = 7, /* axes: three of positions, three of normals, one of rooms */
    ROOM = 6,
    LEAST_HALF = 8,   /* each half of a cut has at least 1 / LEAST_HALF of the points */
    DEEPEST_CUT = 48, /* most nested cuts in the middle of a range */
    PART = 1 << 12    /* most points in a part of the tree, which one thread builds */
};

static const char WHAT[] = "the tree of links";

/* m: more than any scene has. */
static const float ENDLESS = 1e18f;

/* A point as an item of the tree under construction. */
struct item {
    float at[AXES]; /* position, normal and room */
    struct kiln_vec3 edge_s, edge_t;
    float area, level; /* level: first light over the mean */
    uint32_t number, point;
};

/* A part of the tree that one thread builds: its nodes, numbered from 0. */
struct builder {
    struct item *items; /* all items, sorted into the order of the tree as far as it is known */
    struct kiln_link_node *nodes;
    size_t count, room;
};

/* The items `first` to `first + count` of the order. */
struct range {
    uint32_t first, count, depth;
};

static inline float least(float a, float b) { return b < a ? b : a; }
static inline float most(float a, float b) { return b > a ? b : a; }

static inline struct kiln_vec3 centre_of(const struct item *i) { return vec3(i->at[0], i->at[1], i->at[2]); }
static inline struct kiln_vec3 normal_of(const struct item *i) { return vec3(i->at[3], i->at[4], i->at[5]); }

/* ---- cuts ---- */

struct cut {
    int axis;
    float at;
};

/* Finds the axis along which the range is longest, and its middle. Returns false if all points have the same position
 * and normal. */
static bool find_cut(const struct item *items, uint32_t count, struct cut *cut)
{
    float low[AXES], high[AXES];
    for (int a = 0; a < AXES; a++)
        low[a] = INFINITY, high[a] = -INFINITY;
    for (uint32_t i = 0; i < count; i++)
        for (int a = 0; a < AXES; a++)
            low[a] = least(low[a], items[i].at[a]), high[a] = most(high[a], items[i].at[a]);
    if (high[ROOM] > low[ROOM]) { /* rooms come apart before all else */
        *cut = (struct cut){ROOM, 0.5f * low[ROOM] + 0.5f * high[ROOM]};
        return true;
    }
    const float diagonal = vec3_length(vec3(high[0] - low[0], high[1] - low[1], high[2] - low[2]));
    float longest = 0.0f;
    for (int a = 0; a < ROOM; a++) {
        const float length = (high[a] - low[a]) * (a < 3 ? 1.0f : diagonal);
        if (!(length > longest))
            continue;
        longest = length;
        *cut = (struct cut){a, 0.5f * low[a] + 0.5f * high[a]};
    }
    return longest > 0.0f;
}

/* Moves the items before the cut to the front; returns their number. */
static uint32_t cut_range(struct item *items, uint32_t count, struct cut cut)
{
    uint32_t before = 0, behind = count;
    for (;;) {
        while (before < behind && items[before].at[cut.axis] < cut.at)
            before++;
        while (before < behind && !(items[behind - 1].at[cut.axis] < cut.at))
            behind--;
        if (before == behind)
            return before;
        const struct item one = items[before];
        items[before++] = items[--behind];
        items[behind] = one;
    }
}

struct keyed {
    float key;
    struct item item;
};

static int compare_keyed(const void *a, const void *b)
{
    const struct keyed *x = a, *y = b;
    return x->key != y->key ? (x->key < y->key ? -1 : 1)
                            : (x->item.number > y->item.number) - (x->item.number < y->item.number);
}

/* Sorts along the axis. */
static int sort_range(struct item *items, uint32_t count, int axis, struct kiln_error *error)
{
    struct keyed *keyed = NULL;
    const int status = kiln_allocate(&keyed, count, sizeof *keyed, "the order of surface points", error);
    if (status != KILN_OK)
        return status;
    for (uint32_t i = 0; i < count; i++)
        keyed[i] = (struct keyed){items[i].at[axis], items[i]};
    qsort(keyed, count, sizeof *keyed, compare_keyed);
    for (uint32_t i = 0; i < count; i++)
        items[i] = keyed[i].item;
    kiln_free(&keyed);
    return KILN_OK;
}

/* Cuts a range of two points or more; *before: how many are in the first half. */
static int halve(const struct builder *b, struct range r, uint32_t *before, struct kiln_error *error)
{
    struct cut cut = {0, 0.0f};
    struct item *items = b->items + r.first;
    *before = r.count / 2;
    if (!find_cut(items, r.count, &cut))
        return KILN_OK;
    const uint32_t middle = cut_range(items, r.count, cut), fewest = cut.axis < 3 ? r.count / LEAST_HALF : 1;
    if (middle > 0 && middle < r.count && middle >= fewest && r.count - middle >= fewest && r.depth < DEEPEST_CUT) {
        *before = middle;
        return KILN_OK;
    }
    return sort_range(items, r.count, cut.axis, error);
}

/* ---- nodes ---- */

struct sums {
    double area, level, centre[3], normal[3];
};

static void find_means(const struct builder *b, struct range r, struct kiln_link_node *node)
{
    struct sums s = {.area = 0.0};
    for (uint32_t i = 0; i < r.count; i++) {
        const struct item *p = &b->items[r.first + i];
        const double area = (double)p->area;
        s.area += area;
        s.level += area * (double)p->level;
        for (int c = 0; c < 3; c++) {
            s.centre[c] += area * (double)p->at[c];
            s.normal[c] += area * (double)p->at[3 + c];
        }
        node->most_area = most(node->most_area, p->area);
    }
    node->area = (float)s.area;
    node->centre = vec3((float)(s.centre[0] / s.area), (float)(s.centre[1] / s.area), (float)(s.centre[2] / s.area));
    node->normal = vec3((float)(s.normal[0] / s.area), (float)(s.normal[1] / s.area), (float)(s.normal[2] / s.area));
    node->level = (float)(s.level / s.area);
}

/* Adds a point's contribution to the covariance: from its position, and from its own extent. */
static void add_covariance(double sum[6], const struct item *p, struct kiln_vec3 off)
{
    static const int row[6] = {0, 1, 2, 0, 0, 1}, column[6] = {0, 1, 2, 1, 2, 2};
    const double area = (double)p->area, d[3] = {(double)off.x, (double)off.y, (double)off.z},
                 s[3] = {(double)p->edge_s.x, (double)p->edge_s.y, (double)p->edge_s.z},
                 t[3] = {(double)p->edge_t.x, (double)p->edge_t.y, (double)p->edge_t.z};
    for (int i = 0; i < 6; i++)
        sum[i] += area * (d[row[i]] * d[column[i]] + (s[row[i]] * s[column[i]] + t[row[i]] * t[column[i]]) / 12.0);
}

static void find_extents(const struct builder *b, struct range r, struct kiln_link_node *node)
{
    double covariance[6] = {0.0}, spread = 0.0;
    bool mixed = false;
    for (uint32_t i = 0; i < r.count; i++) {
        const struct item *p = &b->items[r.first + i];
        const struct kiln_vec3 off = vec3_sub(centre_of(p), node->centre);
        const float corner = 0.5f * sqrtf(vec3_dot(p->edge_s, p->edge_s) + vec3_dot(p->edge_t, p->edge_t)),
                    tilt = 0.5f * (fabsf(vec3_dot(node->normal, p->edge_s)) + fabsf(vec3_dot(node->normal, p->edge_t)));
        const double level = (double)p->level - (double)node->level;
        node->radius = most(node->radius, vec3_length(off) + corner);
        node->height = most(node->height, fabsf(vec3_dot(node->normal, off)) + tilt);
        node->bend = most(node->bend, vec3_length(vec3_sub(normal_of(p), node->normal)));
        add_covariance(covariance, p, off);
        spread += (double)p->area * level * level;
        mixed = mixed || p->at[ROOM] != b->items[r.first].at[ROOM];
    }
    node->radius = mixed ? ENDLESS : node->radius;
    for (int i = 0; i < 6; i++)
        node->covariance[i] = (float)(covariance[i] / (double)node->area);
    node->spread = (float)sqrt(spread / (double)node->area);
}

static int build(struct builder *b, struct range r, uint32_t *number, struct kiln_error *error);

/* Adds a child to a node, built from a part of the node's range. */
static int add_child(struct builder *b, uint32_t node, struct range part, struct kiln_error *error)
{
    uint32_t child = part.first | KILN_LINK_LEAF;
    const int status = part.count > 1 ? build(b, part, &child, error) : KILN_OK;
    b->nodes[node].child[b->nodes[node].children++] = child;
    return status;
}

/* Cuts a half of a node's range into halves; `halves[1]` may be empty. */
static int halve_half(const struct builder *b, struct range half, struct range halves[2], struct kiln_error *error)
{
    uint32_t before = half.count;
    const int status = half.count > 1 ? halve(b, half, &before, error) : KILN_OK;
    halves[0] = (struct range){half.first, before, half.depth + 1};
    halves[1] = (struct range){half.first + before, half.count - before, half.depth + 1};
    return status;
}

/* Cuts the range of a node with more points than children into its children's ranges. Empty ranges are left out. */
static int quarter(const struct builder *b, struct range r, struct range parts[KILN_LINK_CHILDREN],
                   struct kiln_error *error)
{
    uint32_t before;
    int status;
    KILN_TRY(halve(b, r, &before, error));
    KILN_TRY(halve_half(b, (struct range){r.first, before, r.depth + 1}, parts, error));
    KILN_TRY(halve_half(b, (struct range){r.first + before, r.count - before, r.depth + 1}, parts + 2, error));
end:
    return status;
}

static int add_node(struct builder *b, struct range r, uint32_t *number, struct kiln_error *error)
{
    const int status = kiln_grow(&b->nodes, &b->room, b->count + 1, sizeof *b->nodes, WHAT, error);
    if (status != KILN_OK)
        return status;
    *number = (uint32_t)b->count++;
    b->nodes[*number] = (struct kiln_link_node){.first = r.first, .count = r.count};
    find_means(b, r, &b->nodes[*number]);
    find_extents(b, r, &b->nodes[*number]);
    return KILN_OK;
}

/* Builds a node of two points or more, and its subtree. */
static int build(struct builder *b, struct range r, uint32_t *number, struct kiln_error *error)
{
    struct range parts[KILN_LINK_CHILDREN];
    int status = add_node(b, r, number, error);
    for (uint32_t i = 0; i < KILN_LINK_CHILDREN; i++)
        parts[i] = (struct range){r.first + i, i < r.count, 0};
    if (status == KILN_OK && r.count > KILN_LINK_CHILDREN)
        status = quarter(b, r, parts, error);
    for (uint32_t i = 0; i < KILN_LINK_CHILDREN && status == KILN_OK; i++)
        if (parts[i].count > 0)
            status = add_child(b, *number, parts[i], error);
    return status;
}

/* ---- branches: upper nodes and parts, built by several threads ---- */

/* A range of items: a part, built as a whole, or a node above other branches. */
struct branch {
    struct range range;
    struct builder own; /* the part's nodes, or that one */
    struct range parts[KILN_LINK_CHILDREN];
    size_t child[KILN_LINK_CHILDREN]; /* branches of those children that have a node */
    uint32_t first;                   /* number of its first node among all */
};

struct branches {
    struct branch *of; /* branches level by level, from the top */
    size_t count, room;
};

static bool is_part(const struct branch *b) { return b->range.count <= PART; }

static int add_branch(struct branches *all, struct item *items, struct range r, struct kiln_error *error)
{
    const int status = kiln_grow(&all->of, &all->room, all->count + 1, sizeof *all->of, WHAT, error);
    if (status == KILN_OK)
        all->of[all->count++] = (struct branch){.range = r, .own = {.items = items}};
    return status;
}

/* Builds a part, or makes a single node and cuts its range. */
static int work_on(struct branch *b, struct kiln_error *error)
{
    uint32_t number;
    if (is_part(b))
        return build(&b->own, b->range, &number, error);
    const int status = add_node(&b->own, b->range, &number, error);
    return status == KILN_OK ? quarter(&b->own, b->range, b->parts, error) : status;
}

/* Appends the branches below those from `begin` to `end`. */
static int add_level(struct branches *all, size_t begin, size_t end, struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t i = begin; i < end; i++)
        for (uint32_t k = 0; k < KILN_LINK_CHILDREN && !is_part(&all->of[i]) && status == KILN_OK; k++) {
            const struct branch *b = &all->of[i];
            struct kiln_link_node *node = b->own.nodes;
            const struct range part = b->parts[k];
            if (part.count == 0)
                continue;
            if (part.count > 1) {
                all->of[i].child[node->children] = all->count;
                status = add_branch(all, b->own.items, part, error);
            }
            node->child[node->children++] = part.first | KILN_LINK_LEAF; /* of a branch, until it has a number */
        }
    return status;
}

/* Builds the branches level by level, those of one level in parallel. */
static int build_branches(struct branches *all, struct item *items, uint32_t count, struct kiln_error *error)
{
    int status = add_branch(all, items, (struct range){0, count, 0}, error);
    for (size_t begin = 0; begin < all->count && status == KILN_OK;) {
        const size_t end = all->count;
#pragma omp parallel for schedule(dynamic, 1)
        for (size_t i = begin; i < end; i++) {
            struct kiln_error own_error;
            const int own = work_on(&all->of[i], &own_error);
#pragma omp critical(kiln_link_build)
            if (own != KILN_OK && status == KILN_OK)
                status = kiln_fail(error, own, "%s", own_error.message);
        }
        if (status == KILN_OK)
            status = add_level(all, begin, end, error);
        begin = end;
    }
    return status;
}

static bool is_branch(const struct branch *b, uint32_t child)
{
    return !is_part(b) && (b->own.nodes->child[child] & KILN_LINK_LEAF) != 0 && b->child[child] != 0;
}

/* Numbers the nodes below a branch in depth-first order: a node before its children, these in their order. */
static uint32_t number_nodes(struct branches *all, size_t branch, uint32_t next)
{
    struct branch *b = &all->of[branch];
    b->first = next;
    next += (uint32_t)b->own.count;
    for (uint32_t k = 0; !is_part(b) && k < b->own.nodes->children; k++)
        if (is_branch(b, k))
            next = number_nodes(all, b->child[k], next);
    return next;
}

/* Brings a branch's nodes to their place among all. */
static void place_nodes(const struct branches *all, struct branch *b, struct kiln_link_node *nodes)
{
    for (size_t i = 0; i < b->own.count; i++) {
        struct kiln_link_node node = b->own.nodes[i];
        for (uint32_t k = 0; k < node.children; k++)
            if (is_branch(b, k))
                node.child[k] = all->of[b->child[k]].first;
            else if ((node.child[k] & KILN_LINK_LEAF) == 0)
                node.child[k] += b->first;
        nodes[b->first + i] = node;
    }
}

/* Joins what was built. */
static int join(struct branches *all, struct kiln_link_nodes *nodes, struct kiln_error *error)
{
    nodes->count = number_nodes(all, 0, 0);
    int status;
    KILN_TRY(kiln_arena_allocate(&nodes->arena, &nodes->of, nodes->count, sizeof *nodes->of, WHAT, error));
    KILN_TRY(kiln_arena_allocate(&nodes->arena, &nodes->parts, all->count, sizeof *nodes->parts, WHAT, error));
    KILN_TRY(kiln_arena_allocate(&nodes->arena, &nodes->over, all->count, sizeof *nodes->over, WHAT, error));
end:
    if (status != KILN_OK)
        return status;
#pragma omp parallel for schedule(dynamic, 1)
    for (size_t i = 0; i < all->count; i++)
        place_nodes(all, &all->of[i], nodes->of);
    for (size_t i = 0; i < all->count; i++) {
        const struct branch *b = &all->of[i];
        if (is_part(b))
            nodes->parts[nodes->part_count++] = (struct kiln_link_subtree){b->first, (uint32_t)b->own.count};
        else
            nodes->over[nodes->over_count++] = b->first;
    }
    return KILN_OK;
}

/* ---- the tree ---- */

static struct item item_of(const struct kiln_patch *points, const float *first, const uint32_t *rooms, uint32_t point)
{
    const struct kiln_patch *p = &points[point];
    return (struct item){
        .at = {p->centre.x, p->centre.y, p->centre.z, p->normal.x, p->normal.y, p->normal.z, (float)rooms[point]},
        .edge_s = p->edge_s,
        .edge_t = p->edge_t,
        .area = p->area,
        .level = first[point],
        .number = p->number,
        .point = point};
}

int kiln_link_build(const struct kiln_patch *points, const float *first, const uint32_t *rooms, uint32_t *order,
                    uint32_t count, struct kiln_link_nodes *nodes, struct kiln_error *error)
{
    struct branches all = {.of = NULL};
    struct item *items = NULL;
    if (count < 2)
        return KILN_OK; /* a single point sees nothing but itself */
    int status = kiln_allocate(&items, count, sizeof *items, WHAT, error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for schedule(static)
    for (uint32_t i = 0; i < count; i++)
        items[i] = item_of(points, first, rooms, order[i]);
    status = build_branches(&all, items, count, error);
    if (status == KILN_OK)
        status = join(&all, nodes, error);
#pragma omp parallel for schedule(static)
    for (uint32_t i = 0; i < count; i++)
        order[i] = items[i].point;
    for (size_t i = 0; i < all.count; i++)
        kiln_free(&all.of[i].own.nodes);
    kiln_free(&all.of);
    kiln_free(&items);
    return status;
}

uint64_t kiln_link_build_bytes(uint64_t points)
{
    /* nodes have four children, except the last ones; parts allocate up to twice as many */
    return points * sizeof(struct item) + points / 2 * (2 * sizeof(struct kiln_link_node));
}

void kiln_link_nodes_release(struct kiln_link_nodes *nodes) { kiln_arena_release(&nodes->arena); }
