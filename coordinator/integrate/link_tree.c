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
    struct kiln_link_leaf *leaves; /* the points in this order */
    uint64_t count;
    struct kiln_link_node *nodes;
    size_t node_count, node_room;
    struct kiln_link_sent *sent; /* of nodes */
    float *first;                /* luminance of first light of all points, over the mean, by global index */
    double mean;                 /* of that */
};

/* A point as the tree is built of it; a cache line. */
struct item {
    float at[AXES]; /* its centre, and its normal */
    struct kiln_vec3 edge_s, edge_t;
    float area, level; /* level: first light over the mean */
    uint32_t number, point;
};

/* What a tree is built with. */
struct builder {
    struct kiln_link_tree *tree;
    struct item *items; /* in the order of the tree, as far as that stands */
};

/* Points `first` to `first + count` of the order. */
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

/* Where the range is longest; false: its points have one place and one normal. */
static bool find_cut(const struct item *items, uint32_t count, struct cut *cut)
{
    float low[AXES], high[AXES];
    for (int a = 0; a < AXES; a++)
        low[a] = INFINITY, high[a] = -INFINITY;
    for (uint32_t i = 0; i < count; i++)
        for (int a = 0; a < AXES; a++)
            low[a] = least(low[a], items[i].at[a]), high[a] = most(high[a], items[i].at[a]);
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

/* Brings what is before the cut to the front; how many these are. */
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

/* Adds a point's share of the covariance: its place, and its own size. */
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

/* First light of all points over the mean. */
static int find_first(struct kiln_link_tree *t, const float *light, uint64_t count, struct kiln_error *error)
{
    t->mean = mean_light(t, light);
    const int status = kiln_allocate(&t->first, (size_t)count, sizeof *t->first, "the light of links", error);
    for (uint64_t i = 0; i < count && status == KILN_OK; i++)
        t->first[i] = t->mean > 0.0 ? (float)((double)light[i] / t->mean) : 0.0f;
    return status;
}

static struct item item_of(const struct kiln_link_tree *t, uint32_t point)
{
    const struct kiln_patch *p = &t->points[point];
    return (struct item){.at = {p->centre.x, p->centre.y, p->centre.z, p->normal.x, p->normal.y, p->normal.z},
                         .edge_s = p->edge_s,
                         .edge_t = p->edge_t,
                         .area = p->area,
                         .level = t->first[point],
                         .number = p->number,
                         .point = point};
}

static int build_all(struct kiln_link_tree *t, struct kiln_error *error)
{
    struct builder b = {t, NULL};
    uint32_t root;
    if (t->count < 2)
        return KILN_OK; /* nothing but itself is there to be seen */
    int status = kiln_allocate(&b.items, (size_t)t->count, sizeof *b.items, "the tree of links", error);
    for (uint64_t i = 0; i < t->count && status == KILN_OK; i++)
        b.items[i] = item_of(t, t->order[i]);
    if (status == KILN_OK)
        status = build(&b, (struct range){0, (uint32_t)t->count, 0}, &root, error);
    for (uint64_t i = 0; i < t->count && status == KILN_OK; i++)
        t->order[i] = b.items[i].point;
    kiln_free(&b.items);
    return status;
}

/* Room for the light of nodes and points, and the points themselves, when their order stands. */
static int make_leaves(struct kiln_link_tree *t, struct kiln_error *error)
{
    static const char what[] = "the light of links";
    int status = kiln_allocate(&t->sent, t->node_count, sizeof *t->sent, what, error);
    if (status == KILN_OK)
        status = kiln_allocate(&t->leaves, (size_t)t->count, sizeof *t->leaves, what, error);
    for (uint64_t i = 0; i < t->count && status == KILN_OK; i++) {
        const struct kiln_patch *p = &t->points[t->order[i]];
        t->leaves[i] = (struct kiln_link_leaf){
            .place = p->place, .centre = p->centre, .normal = p->normal, .area = p->area, .number = p->number};
    }
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
    if (status == KILN_OK)
        status = find_first(t, light, count, error);
    if (status == KILN_OK)
        status = build_all(t, error);
    if (status == KILN_OK)
        status = make_leaves(t, error);
    if (status != KILN_OK)
        kiln_link_tree_destroy(tree);
    return status;
}

void kiln_link_tree_destroy(struct kiln_link_tree **tree)
{
    if (*tree == NULL)
        return;
    kiln_free(&(*tree)->order);
    kiln_free(&(*tree)->leaves);
    kiln_free(&(*tree)->nodes);
    kiln_free(&(*tree)->sent);
    kiln_free(&(*tree)->first);
    kiln_free(tree);
}

uint64_t kiln_link_tree_bytes(uint64_t points)
{
    const struct kiln_link_tree *t = NULL;
    /* a node has four children, but for the last; and room that has grown has up to twice as much. The leaves come in
     * the place of items. */
    _Static_assert(sizeof(struct item) <= sizeof *t->leaves, "items have room where leaves have");
    return points * (sizeof *t->order + sizeof *t->leaves + sizeof *t->first) +
           points / 2 * (2 * sizeof *t->nodes + sizeof *t->sent);
}

/* A point's light: what it sends in this bounce, and what it has sent before. */
static void take_point(struct kiln_link_tree *t, uint64_t i, uint32_t bounce)
{
    struct kiln_link_leaf *leaf = &t->leaves[i];
    const float sent = kiln_luminance_in_float(leaf->radiosity),
                first = (float)((double)t->first[t->order[i]] * t->mean);
    leaf->before = bounce <= 1 ? 0.0f : first + (float)(bounce - 2) * sent;
    leaf->now = leaf->before + sent;
}

/* What a child sends, and where it lies. */
struct part {
    double area;
    struct kiln_vec3 centre;
    struct kiln_link_sent sent;
};

static struct part part_of(const struct kiln_link_tree *t, uint32_t child)
{
    const uint32_t at = child & ~KILN_LINK_LEAF;
    if ((child & KILN_LINK_LEAF) == 0)
        return (struct part){(double)t->nodes[at].area, t->nodes[at].centre, t->sent[at]};
    const struct kiln_link_leaf *leaf = &t->leaves[at];
    return (struct part){(double)leaf->area,
                         leaf->centre,
                         {.radiosity = {leaf->radiosity[0], leaf->radiosity[1], leaf->radiosity[2]},
                          .light = {.now = leaf->now, .before = leaf->before}}};
}

/* Means of children, and of squares: those of their means, and what they differ by themselves. */
static struct kiln_link_light mean_of_light(const struct part *parts, uint32_t count, double area)
{
    double now[2] = {0.0}, before[2] = {0.0};
    for (uint32_t i = 0; i < count; i++) {
        const struct kiln_link_light *l = &parts[i].sent.light;
        const double own = parts[i].area / area;
        now[0] += own * (double)l->now;
        now[1] += own * ((double)l->now * (double)l->now + (double)l->spread_now);
        before[0] += own * (double)l->before;
        before[1] += own * ((double)l->before * (double)l->before + (double)l->spread_before);
    }
    return (struct kiln_link_light){(float)now[0], (float)before[0], (float)fmax(0.0, now[1] - now[0] * now[0]),
                                    (float)fmax(0.0, before[1] - before[0] * before[0])};
}

/* The moment of children about a node's centre, of one colour: theirs, and those of their means. */
static void find_moment(const struct part *parts, uint32_t count, double area, struct kiln_vec3 centre, int c,
                        struct kiln_link_sent *sent)
{
    double sum[3] = {0.0};
    for (uint32_t i = 0; i < count; i++) {
        const struct kiln_dvec3 off = dvec3_sub(dvec3_of(parts[i].centre), dvec3_of(centre));
        const float *own = parts[i].sent.moment[c];
        const double more = (double)parts[i].sent.radiosity[c] - (double)sent->radiosity[c];
        sum[0] += parts[i].area * (more * off.x + (double)own[0]);
        sum[1] += parts[i].area * (more * off.y + (double)own[1]);
        sum[2] += parts[i].area * (more * off.z + (double)own[2]);
    }
    for (int a = 0; a < 3; a++)
        sent->moment[c][a] = (float)(sum[a] / area);
}

static void take_node(struct kiln_link_tree *t, size_t n)
{
    const struct kiln_link_node *node = &t->nodes[n];
    struct kiln_link_sent *sent = &t->sent[n];
    struct part parts[KILN_LINK_CHILDREN];
    double area = 0.0, sum[3] = {0.0};
    for (uint32_t i = 0; i < node->children; i++) {
        parts[i] = part_of(t, node->child[i]);
        area += parts[i].area;
        for (int c = 0; c < 3; c++)
            sum[c] += parts[i].area * (double)parts[i].sent.radiosity[c];
    }
    for (int c = 0; c < 3; c++) {
        sent->radiosity[c] = (float)(sum[c] / area);
        find_moment(parts, node->children, area, node->centre, c, sent);
    }
    sent->light = mean_of_light(parts, node->children, area);
}

void kiln_link_tree_set_light(struct kiln_link_tree *t, uint32_t bounce, kiln_link_of_point light, const void *context)
{
    for (uint64_t i = 0; i < t->count; i++) {
        light(context, t->order[i], t->leaves[i].radiosity);
        take_point(t, i, bounce);
    }
    for (size_t n = t->node_count; n > 0; n--)
        take_node(t, n - 1);
}

void kiln_link_tree_describe(const struct kiln_link_tree *t, struct kiln_links_parameters *parameters)
{
    parameters->points = t->points;
    parameters->order = t->order;
    parameters->leaves = t->leaves;
    parameters->count = t->count;
    parameters->nodes = t->nodes;
    parameters->node_count = (uint32_t)t->node_count;
    parameters->sent = t->sent;
    parameters->first = t->first;
}
