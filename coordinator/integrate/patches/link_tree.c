#include "coordinator/integrate/patches/link_tree.h"

#include <math.h>
#include <string.h>

#include "coordinator/integrate/patches/link_build.h"
#include "worker/base/arena.h"
#include "worker/base/color.h"
#include "worker/base/memory.h"

struct kiln_link_tree {
    const struct kiln_patch *points;
    const uint32_t *rooms;
    uint32_t *order;
    struct kiln_link_leaf *leaves; /* the points in this order */
    uint64_t count;
    struct kiln_link_nodes nodes;
    struct kiln_link_sent *sent; /* of nodes */
    float *first;                /* luminance of first light of all points, over the mean, by global index */
    double mean;                 /* of that */
    struct kiln_arena arena;
};

/* ---- the tree ---- */

/* Lists the points that send light in the order of their numbers, which are below the count of all points. */
static int order_points(struct kiln_link_tree *t, uint64_t count, struct kiln_error *error)
{
    int status = kiln_arena_allocate(&t->arena, &t->order, (size_t)count, sizeof *t->order,
                                     "the order of surface points", error);
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
    const int status =
        kiln_arena_allocate(&t->arena, &t->first, (size_t)count, sizeof *t->first, "the light of links", error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for schedule(static)
    for (uint64_t i = 0; i < count; i++)
        t->first[i] = t->mean > 0.0 ? (float)((double)light[i] / t->mean) : 0.0f;
    return KILN_OK;
}

/* Allocates the light of nodes and points, and the points in the order of the tree. */
static int make_leaves(struct kiln_link_tree *t, struct kiln_error *error)
{
    static const char what[] = "the light of links";
    int status = kiln_arena_allocate(&t->arena, &t->sent, t->nodes.count, sizeof *t->sent, what, error);
    if (status == KILN_OK)
        status = kiln_arena_allocate(&t->arena, &t->leaves, (size_t)t->count, sizeof *t->leaves, what, error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for schedule(static)
    for (uint64_t i = 0; i < t->count; i++) {
        const struct kiln_patch *p = &t->points[t->order[i]];
        t->leaves[i] = (struct kiln_link_leaf){
            .place = p->place, .centre = p->centre, .normal = p->normal, .area = p->area, .number = p->number};
    }
    return KILN_OK;
}

int kiln_link_tree_create(struct kiln_link_tree **tree, const struct kiln_patch *points, const uint32_t *rooms,
                          const float *light, uint64_t count, struct kiln_error *error)
{
    struct kiln_link_tree *t = NULL;
    int status = kiln_allocate(&t, 1, sizeof *t, "the tree of links", error);
    *tree = t;
    if (status != KILN_OK)
        return status;
    t->points = points;
    t->rooms = rooms;
    KILN_TRY(order_points(t, count, error));
    KILN_TRY(find_first(t, light, count, error));
    KILN_TRY(kiln_link_build(points, t->first, rooms, t->order, (uint32_t)t->count, &t->nodes, error));
    KILN_TRY(make_leaves(t, error));
end:
    if (status != KILN_OK)
        kiln_link_tree_destroy(tree);
    return status;
}

void kiln_link_tree_destroy(struct kiln_link_tree **tree)
{
    if (*tree == NULL)
        return;
    kiln_link_nodes_release(&(*tree)->nodes);
    kiln_arena_release(&(*tree)->arena);
    kiln_free(tree);
}

uint64_t kiln_link_tree_bytes(uint64_t points)
{
    const struct kiln_link_tree *t = NULL;
    const uint64_t build = kiln_link_build_bytes(points),
                   light = points * sizeof *t->leaves + points / 2 * sizeof *t->sent;
    return points * (sizeof *t->order + sizeof *t->first) + points / 2 * sizeof *t->nodes.of +
           (build > light ? build : light);
}

/* Sets a point's light: radiosity sent in this bounce, and in all bounces before. */
static void take_point(struct kiln_link_tree *t, uint64_t i, uint32_t bounce)
{
    struct kiln_link_leaf *leaf = &t->leaves[i];
    const float sent = kiln_luminance_in_float(leaf->radiosity),
                first = (float)((double)t->first[t->order[i]] * t->mean);
    leaf->before = bounce <= 1 ? 0.0f : first + (float)(bounce - 2) * sent;
    leaf->now = leaf->before + sent;
}

/* A child of a node: area, centre, and the light it sends. */
struct part {
    double area;
    struct kiln_vec3 centre;
    struct kiln_link_sent sent;
};

static struct part part_of(const struct kiln_link_tree *t, uint32_t child)
{
    const uint32_t at = child & ~KILN_LINK_LEAF;
    if ((child & KILN_LINK_LEAF) == 0)
        return (struct part){(double)t->nodes.of[at].area, t->nodes.of[at].centre, t->sent[at]};
    const struct kiln_link_leaf *leaf = &t->leaves[at];
    return (struct part){(double)leaf->area,
                         leaf->centre,
                         {.radiosity = {leaf->radiosity[0], leaf->radiosity[1], leaf->radiosity[2]},
                          .light = {.now = leaf->now, .before = leaf->before}}};
}

/* Computes the means of children's light, and of its square: that of the children's means plus the variation within
 * each child. */
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

/* Computes the moment of light about a node's centre, for one colour: the children's own moments, plus those of their
 * means. */
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
    const struct kiln_link_node *node = &t->nodes.of[n];
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
#pragma omp parallel for schedule(static)
    for (uint64_t i = 0; i < t->count; i++) {
        light(context, t->order[i], t->leaves[i].radiosity);
        take_point(t, i, bounce);
    }
#pragma omp parallel for schedule(dynamic, 1)
    for (size_t i = 0; i < t->nodes.part_count; i++) {
        const struct kiln_link_subtree *part = &t->nodes.parts[i];
        for (size_t n = part->first + part->count; n > part->first; n--)
            take_node(t, n - 1);
    }
    for (size_t i = t->nodes.over_count; i > 0; i--)
        take_node(t, t->nodes.over[i - 1]);
}

void kiln_link_tree_describe(const struct kiln_link_tree *t, struct kiln_links_parameters *parameters)
{
    parameters->points = t->points;
    parameters->order = t->order;
    parameters->leaves = t->leaves;
    parameters->count = t->count;
    parameters->nodes = t->nodes.of;
    parameters->node_count = (uint32_t)t->nodes.count;
    parameters->sent = t->sent;
    parameters->rooms = t->rooms;
    parameters->first = t->first;
}
