#include "coordinator/integrate/link_tree.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "worker/base/color.h"
#include "worker/base/memory.h"

enum {
    AXES = 6,         /* of places, then of normals */
    LEAST_HALF = 8,   /* one half has at least so many-th of the points */
    DEEPEST_CUT = 48, /* cuts in the middle above each other */
};

struct kiln_link_tree {
    const struct kiln_patch *points;
    uint32_t *order;
    float *area; /* of the points in this order */
    uint64_t count;
    struct kiln_link_node *nodes;
    size_t node_count, node_room;
    float (*radiosity)[3], (*leaf_radiosity)[3];
    struct kiln_link_light *light, *leaf_light;
    float *first; /* luminance of first light of all points, over the mean, by global index */
    double mean;  /* of that */
};

/* What a tree is built with. */
struct builder {
    struct kiln_link_tree *tree;
    const float *light;
    double mean;      /* of light */
    uint32_t *behind; /* what of a range goes to its second half */
};

/* Points `first` to `first + count` of the order. */
struct range {
    uint32_t first, count, depth;
};

static float coordinate(const struct kiln_patch *p, int axis)
{
    const struct kiln_vec3 *v = axis < 3 ? &p->centre : &p->normal;
    return axis % 3 == 0 ? v->x : axis % 3 == 1 ? v->y : v->z;
}

/* ---- cuts ---- */

struct cut {
    int axis;
    float at;
};

/* Where the range is longest; false: its points have one place and one normal. */
static bool find_cut(const struct kiln_link_tree *t, struct range r, struct cut *cut)
{
    float low[AXES], high[AXES];
    for (int a = 0; a < AXES; a++)
        low[a] = INFINITY, high[a] = -INFINITY;
    for (uint32_t i = 0; i < r.count; i++)
        for (int a = 0; a < AXES; a++) {
            const float x = coordinate(&t->points[t->order[r.first + i]], a);
            low[a] = fminf(low[a], x), high[a] = fmaxf(high[a], x);
        }
    const float diagonal = vec3_length(vec3(high[0] - low[0], high[1] - low[1], high[2] - low[2]));
    float longest = 0.0f;
    for (int a = 0; a < AXES; a++) {
        const float length = (high[a] - low[a]) * (a < 3 ? 1.0f : diagonal);
        if (!(length > longest))
            continue;
        longest = length;
        *cut = (struct cut){a, 0.5f * low[a] + 0.5f * high[a]};
    }
    return longest > 0.0f;
}

/* Brings what is before the cut to the front, all in their order; how many these are. */
static uint32_t cut_range(const struct builder *b, struct range r, struct cut cut)
{
    const struct kiln_link_tree *t = b->tree;
    uint32_t *order = t->order + r.first, before = 0, behind = 0;
    for (uint32_t i = 0; i < r.count; i++) {
        if (coordinate(&t->points[order[i]], cut.axis) < cut.at)
            order[before++] = order[i];
        else
            b->behind[behind++] = order[i];
    }
    memcpy(order + before, b->behind, behind * sizeof *order);
    return before;
}

struct keyed {
    float key;
    uint32_t number, point;
};

static int compare_keyed(const void *a, const void *b)
{
    const struct keyed *x = a, *y = b;
    return x->key != y->key ? (x->key < y->key ? -1 : 1) : (x->number > y->number) - (x->number < y->number);
}

/* Sorts along the axis. */
static int sort_range(const struct builder *b, struct range r, int axis, struct kiln_error *error)
{
    const struct kiln_link_tree *t = b->tree;
    uint32_t *order = t->order + r.first;
    struct keyed *keyed = NULL;
    const int status = kiln_allocate(&keyed, r.count, sizeof *keyed, "the order of surface points", error);
    if (status != KILN_OK)
        return status;
    for (uint32_t i = 0; i < r.count; i++)
        keyed[i] = (struct keyed){coordinate(&t->points[order[i]], axis), t->points[order[i]].number, order[i]};
    qsort(keyed, r.count, sizeof *keyed, compare_keyed);
    for (uint32_t i = 0; i < r.count; i++)
        order[i] = keyed[i].point;
    kiln_free(&keyed);
    return KILN_OK;
}

/* Cuts a range of two points or more; *before: how many are in the first half. */
static int halve(const struct builder *b, struct range r, uint32_t *before, struct kiln_error *error)
{
    struct cut cut = {0, 0.0f};
    *before = r.count / 2;
    if (!find_cut(b->tree, r, &cut))
        return KILN_OK;
    const uint32_t middle = cut_range(b, r, cut), least = cut.axis < 3 ? r.count / LEAST_HALF : 1;
    if (middle > 0 && middle < r.count && middle >= least && r.count - middle >= least && r.depth < DEEPEST_CUT) {
        *before = middle;
        return KILN_OK;
    }
    return sort_range(b, r, cut.axis, error);
}

/* ---- nodes ---- */

struct sums {
    double area, level, centre[3], normal[3];
};

static void find_means(const struct builder *b, struct range r, struct kiln_link_node *node)
{
    const struct kiln_link_tree *t = b->tree;
    struct sums s = {.area = 0.0};
    for (uint32_t i = 0; i < r.count; i++) {
        const uint32_t point = t->order[r.first + i];
        const struct kiln_patch *p = &t->points[point];
        const double area = (double)p->area;
        s.area += area;
        s.level += area * (double)b->light[point];
        for (int c = 0; c < 3; c++) {
            s.centre[c] += area * (double)coordinate(p, c);
            s.normal[c] += area * (double)coordinate(p, 3 + c);
        }
        node->most_area = fmaxf(node->most_area, p->area);
    }
    node->area = (float)s.area;
    node->centre = vec3((float)(s.centre[0] / s.area), (float)(s.centre[1] / s.area), (float)(s.centre[2] / s.area));
    node->normal = vec3((float)(s.normal[0] / s.area), (float)(s.normal[1] / s.area), (float)(s.normal[2] / s.area));
    node->level = b->mean > 0.0 ? (float)(s.level / s.area / b->mean) : 0.0f;
}

/* Adds a point's share of the covariance: its place, and its own size. */
static void add_covariance(double sum[6], const struct kiln_patch *p, struct kiln_vec3 off)
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
    const struct kiln_link_tree *t = b->tree;
    double covariance[6] = {0.0}, spread = 0.0;
    for (uint32_t i = 0; i < r.count; i++) {
        const uint32_t point = t->order[r.first + i];
        const struct kiln_patch *p = &t->points[point];
        const struct kiln_vec3 off = vec3_sub(p->centre, node->centre);
        const float corner = 0.5f * sqrtf(vec3_dot(p->edge_s, p->edge_s) + vec3_dot(p->edge_t, p->edge_t)),
                    tilt = 0.5f * (fabsf(vec3_dot(node->normal, p->edge_s)) + fabsf(vec3_dot(node->normal, p->edge_t)));
        const double level = b->mean > 0.0 ? (double)b->light[point] / b->mean - (double)node->level : 0.0;
        node->radius = fmaxf(node->radius, vec3_length(off) + corner);
        node->height = fmaxf(node->height, fabsf(vec3_dot(node->normal, off)) + tilt);
        node->bend = fmaxf(node->bend, vec3_length(vec3_sub(p->normal, node->normal)));
        add_covariance(covariance, p, off);
        spread += (double)p->area * level * level;
    }
    for (int i = 0; i < 6; i++)
        node->covariance[i] = (float)(covariance[i] / (double)node->area);
    node->spread = (float)sqrt(spread / (double)node->area);
}

static int build(const struct builder *b, struct range r, uint32_t *number, struct kiln_error *error);

/* The child that a part of a node is. */
static int add_child(const struct builder *b, uint32_t node, struct range part, struct kiln_error *error)
{
    struct kiln_link_tree *t = b->tree;
    uint32_t child = part.first | KILN_LINK_LEAF;
    const int status = part.count > 1 ? build(b, part, &child, error) : KILN_OK;
    t->nodes[node].child[t->nodes[node].children++] = child;
    return status;
}

/* The halves of half a node. */
static int add_half(const struct builder *b, uint32_t node, struct range half, struct kiln_error *error)
{
    uint32_t before = half.count;
    int status = half.count > 1 ? halve(b, half, &before, error) : KILN_OK;
    if (status == KILN_OK)
        status = add_child(b, node, (struct range){half.first, before, half.depth + 1}, error);
    if (status == KILN_OK && before < half.count)
        status = add_child(b, node, (struct range){half.first + before, half.count - before, half.depth + 1}, error);
    return status;
}

/* A node of two points or more. */
static int build(const struct builder *b, struct range r, uint32_t *number, struct kiln_error *error)
{
    struct kiln_link_tree *t = b->tree;
    const uint32_t node = (uint32_t)t->node_count;
    int status = kiln_grow(&t->nodes, &t->node_room, t->node_count + 1, sizeof *t->nodes, "the tree of links", error);
    if (status != KILN_OK)
        return status;
    t->node_count++;
    *number = node;
    t->nodes[node] = (struct kiln_link_node){.first = r.first, .count = r.count};
    find_means(b, r, &t->nodes[node]);
    find_extents(b, r, &t->nodes[node]);
    for (uint32_t i = 0; r.count <= KILN_LINK_CHILDREN && i < r.count && status == KILN_OK; i++)
        status = add_child(b, node, (struct range){r.first + i, 1, 0}, error);
    if (r.count <= KILN_LINK_CHILDREN)
        return status;
    uint32_t before;
    status = halve(b, r, &before, error);
    if (status == KILN_OK)
        status = add_half(b, node, (struct range){r.first, before, r.depth + 1}, error);
    if (status == KILN_OK)
        status = add_half(b, node, (struct range){r.first + before, r.count - before, r.depth + 1}, error);
    return status;
}

/* ---- the tree ---- */

/* The points that send light, in the order of their numbers; their numbers go up to the count of all. */
static int order_points(struct kiln_link_tree *t, uint64_t count, struct kiln_error *error)
{
    int status = kiln_allocate(&t->order, (size_t)count, sizeof *t->order, "the order of surface points", error);
    if (status != KILN_OK)
        return status;
    memset(t->order, 0xff, (size_t)count * sizeof *t->order);
    for (uint64_t i = 0; i < count; i++)
        if (t->points[i].area > 0.0f)
            t->order[t->points[i].number] = (uint32_t)i;
    for (uint64_t i = 0; i < count; i++)
        if (t->order[i] != UINT32_MAX)
            t->order[t->count++] = t->order[i];
    return KILN_OK;
}

static double mean_light(const struct kiln_link_tree *t, const float *light)
{
    double area = 0.0, sum = 0.0;
    for (uint64_t i = 0; i < t->count; i++) {
        area += (double)t->points[t->order[i]].area;
        sum += (double)t->points[t->order[i]].area * (double)light[t->order[i]];
    }
    return area > 0.0 ? sum / area : 0.0;
}

static int build_all(struct kiln_link_tree *t, const float *light, struct kiln_error *error)
{
    struct builder b = {t, light, t->mean, NULL};
    uint32_t root;
    if (t->count < 2)
        return KILN_OK; /* nothing but itself is there to be seen */
    int status = kiln_allocate(&b.behind, (size_t)t->count, sizeof *b.behind, "the tree of links", error);
    if (status == KILN_OK)
        status = build(&b, (struct range){0, (uint32_t)t->count, 0}, &root, error);
    kiln_free(&b.behind);
    return status;
}

/* Room for the light of nodes and points; the points' first light and areas, when their order stands. */
static int make_light(struct kiln_link_tree *t, const float *light, uint64_t count, struct kiln_error *error)
{
    static const char what[] = "the light of links";
    int status = kiln_allocate(&t->radiosity, t->node_count, sizeof *t->radiosity, what, error);
    if (status == KILN_OK)
        status = kiln_allocate(&t->light, t->node_count, sizeof *t->light, what, error);
    if (status == KILN_OK)
        status = kiln_allocate(&t->leaf_radiosity, (size_t)t->count, sizeof *t->leaf_radiosity, what, error);
    if (status == KILN_OK)
        status = kiln_allocate(&t->leaf_light, (size_t)t->count, sizeof *t->leaf_light, what, error);
    if (status == KILN_OK)
        status = kiln_allocate(&t->first, (size_t)count, sizeof *t->first, what, error);
    if (status == KILN_OK)
        status = kiln_allocate(&t->area, (size_t)t->count, sizeof *t->area, what, error);
    for (uint64_t i = 0; i < t->count && status == KILN_OK; i++)
        t->area[i] = t->points[t->order[i]].area;
    for (uint64_t i = 0; i < count && status == KILN_OK; i++)
        t->first[i] = t->mean > 0.0 ? (float)((double)light[i] / t->mean) : 0.0f;
    return status;
}

int kiln_link_tree_create(struct kiln_link_tree **tree, const struct kiln_patch *points, const float *light,
                          uint64_t count, struct kiln_error *error)
{
    struct kiln_link_tree *t = NULL;
    int status = kiln_allocate(&t, 1, sizeof *t, "the tree of links", error);
    *tree = t;
    if (status != KILN_OK)
        return status;
    t->points = points;
    status = order_points(t, count, error);
    if (status == KILN_OK) {
        t->mean = mean_light(t, light);
        status = build_all(t, light, error);
    }
    if (status == KILN_OK)
        status = make_light(t, light, count, error);
    if (status != KILN_OK)
        kiln_link_tree_destroy(tree);
    return status;
}

void kiln_link_tree_destroy(struct kiln_link_tree **tree)
{
    if (*tree == NULL)
        return;
    kiln_free(&(*tree)->order);
    kiln_free(&(*tree)->area);
    kiln_free(&(*tree)->nodes);
    kiln_free(&(*tree)->radiosity);
    kiln_free(&(*tree)->leaf_radiosity);
    kiln_free(&(*tree)->light);
    kiln_free(&(*tree)->leaf_light);
    kiln_free(&(*tree)->first);
    kiln_free(tree);
}

uint64_t kiln_link_tree_bytes(uint64_t points)
{
    const struct kiln_link_tree *t = NULL;
    /* a node has four children, but for the last; and room that has grown has up to twice as much */
    return points * (sizeof *t->order + sizeof *t->area + sizeof *t->leaf_radiosity + sizeof *t->leaf_light +
                     sizeof *t->first) +
           points / 2 * (2 * sizeof *t->nodes + sizeof *t->radiosity + sizeof *t->light);
}

/* Of a child, W/m2; returns its area. */
static double light_of(const struct kiln_link_tree *t, uint32_t child, const float **radiosity,
                       const struct kiln_link_light **light)
{
    const bool leaf = (child & KILN_LINK_LEAF) != 0;
    const uint32_t at = child & ~KILN_LINK_LEAF;
    *radiosity = leaf ? t->leaf_radiosity[at] : t->radiosity[at];
    *light = leaf ? &t->leaf_light[at] : &t->light[at];
    return (double)(leaf ? t->points[t->order[at]].area : t->nodes[at].area);
}

/* A point's light: what it sends in this bounce, and what it has sent before. */
static void take_point(struct kiln_link_tree *t, uint64_t i, uint32_t bounce)
{
    const float sent = kiln_luminance_in_float(t->leaf_radiosity[i]),
                first = (float)((double)t->first[t->order[i]] * t->mean),
                before = bounce <= 1 ? 0.0f : first + (float)(bounce - 2) * sent;
    t->leaf_light[i] = (struct kiln_link_light){.now = before + sent, .before = before};
}

/* Means of children, and of squares: those of their means, and what they differ by themselves. */
static void take_node(struct kiln_link_tree *t, size_t n)
{
    const struct kiln_link_node *node = &t->nodes[n];
    double area = 0.0, sum[3] = {0.0}, now[2] = {0.0}, before[2] = {0.0};
    for (uint32_t i = 0; i < node->children; i++) {
        const float *radiosity;
        const struct kiln_link_light *light;
        const double own = light_of(t, node->child[i], &radiosity, &light);
        area += own;
        for (int c = 0; c < 3; c++)
            sum[c] += own * (double)radiosity[c];
        now[0] += own * (double)light->now;
        now[1] += own * ((double)light->now * (double)light->now + (double)light->spread_now);
        before[0] += own * (double)light->before;
        before[1] += own * ((double)light->before * (double)light->before + (double)light->spread_before);
    }
    for (int c = 0; c < 3; c++)
        t->radiosity[n][c] = (float)(sum[c] / area);
    now[0] /= area, before[0] /= area;
    t->light[n] =
        (struct kiln_link_light){(float)now[0], (float)before[0], (float)fmax(0.0, now[1] / area - now[0] * now[0]),
                                 (float)fmax(0.0, before[1] / area - before[0] * before[0])};
}

void kiln_link_tree_set_light(struct kiln_link_tree *t, uint32_t bounce, kiln_link_of_point light, const void *context)
{
    for (uint64_t i = 0; i < t->count; i++) {
        light(context, t->order[i], t->leaf_radiosity[i]);
        take_point(t, i, bounce);
    }
    for (size_t n = t->node_count; n > 0; n--)
        take_node(t, n - 1);
}

void kiln_link_tree_describe(const struct kiln_link_tree *t, struct kiln_links_parameters *parameters)
{
    parameters->points = t->points;
    parameters->order = t->order;
    parameters->area = t->area;
    parameters->count = t->count;
    parameters->nodes = t->nodes;
    parameters->node_count = (uint32_t)t->node_count;
    parameters->radiosity = (const float(*)[3])t->radiosity;
    parameters->leaf_radiosity = (const float(*)[3])t->leaf_radiosity;
    parameters->first = t->first;
    parameters->light = t->light;
    parameters->leaf_light = t->leaf_light;
}
