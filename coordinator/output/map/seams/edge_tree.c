#include "coordinator/output/map/seams/edge_tree.h"

#include <math.h>
#include <stdlib.h>

#include "worker/base/memory.h"

enum { CHILDREN = 4, LEVELS = 17, BITS = 21 };

struct kiln_edge_tree {
    const struct kiln_edge *edges;
    size_t count;
    uint32_t *order;         /* indices of the edges along the curve; each leaf has CHILDREN of them */
    size_t level_count;      /* of boxes; the last level has one */
    size_t first[LEVELS];    /* of each level in `boxes` */
    size_t in_level[LEVELS]; /* number of boxes */
    struct kiln_box *boxes;
};

/* ---- boxes ---- */

/* fminf and fmaxf would be calls; coordinates are never NaN. */
static inline float least(float a, float b) { return a < b ? a : b; }
static inline float most(float a, float b) { return a > b ? a : b; }

struct kiln_box kiln_box_empty(void)
{
    return (struct kiln_box){{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
}

bool kiln_box_is_empty(const struct kiln_box *b)
{
    return !(b->low[0] <= b->high[0] && b->low[1] <= b->high[1] && b->low[2] <= b->high[2]);
}

void kiln_box_add(struct kiln_box *box, const float point[3])
{
    for (int c = 0; c < 3; c++) {
        box->low[c] = least(box->low[c], point[c]);
        box->high[c] = most(box->high[c], point[c]);
    }
}

void kiln_box_join(struct kiln_box *box, const struct kiln_box *other)
{
    if (kiln_box_is_empty(other))
        return;
    kiln_box_add(box, other->low);
    kiln_box_add(box, other->high);
}

struct kiln_box kiln_box_common(const struct kiln_box *a, const struct kiln_box *b)
{
    struct kiln_box common;
    for (int c = 0; c < 3; c++) {
        common.low[c] = most(a->low[c], b->low[c]);
        common.high[c] = least(a->high[c], b->high[c]);
    }
    return common;
}

void kiln_box_widen(struct kiln_box *box, float by)
{
    for (int c = 0; c < 3; c++) {
        box->low[c] -= by;
        box->high[c] += by;
    }
}

static struct kiln_box box_of(const struct kiln_edge *edge)
{
    struct kiln_box box = kiln_box_empty();
    kiln_box_add(&box, edge->end[0]);
    kiln_box_add(&box, edge->end[1]);
    return box;
}

/* ---- the tree ---- */

/* An edge's place along the curve. */
struct key {
    uint64_t code;
    uint32_t edge;
};

static int compare_keys(const void *a, const void *b)
{
    const struct key *p = a, *q = b;
    if (p->code != q->code)
        return p->code < q->code ? -1 : 1;
    return (p->edge > q->edge) - (p->edge < q->edge);
}

/* Morton code of an edge's middle in the bounding box of all edges. */
static uint64_t code_of(const struct kiln_edge *edge, const struct kiln_box *all)
{
    uint64_t code = 0;
    for (int c = 0; c < 3; c++) {
        const float side = all->high[c] - all->low[c],
                    at = 0.5f * edge->end[0][c] + 0.5f * edge->end[1][c] - all->low[c];
        const float share = side > 0.0f ? fminf(fmaxf(at / side, 0.0f), 1.0f) : 0.0f;
        const uint64_t number = (uint64_t)(share * (float)((1 << BITS) - 1));
        for (int bit = 0; bit < BITS; bit++)
            code |= (number >> bit & 1u) << (3 * bit + c);
    }
    return code;
}

static int sort_edges(struct kiln_edge_tree *t, struct kiln_error *error)
{
    struct key *keys = NULL;
    struct kiln_box all = kiln_box_empty();
    int status;
    KILN_TRY(kiln_allocate(&keys, t->count, sizeof *keys, "the order of edges", error));
    KILN_TRY(kiln_allocate(&t->order, t->count, sizeof *t->order, "the order of edges", error));
    for (size_t i = 0; i < t->count; i++) {
        const struct kiln_box box = box_of(&t->edges[i]);
        kiln_box_join(&all, &box);
    }
    for (size_t i = 0; i < t->count; i++)
        keys[i] = (struct key){code_of(&t->edges[i], &all), (uint32_t)i};
    qsort(keys, t->count, sizeof *keys, compare_keys);
    for (size_t i = 0; i < t->count; i++)
        t->order[i] = keys[i].edge;
end:
    kiln_free(&keys);
    return status;
}

static void fill_level(struct kiln_edge_tree *t, size_t level)
{
    const size_t below = level == 0 ? t->count : t->in_level[level - 1];
    for (size_t i = 0; i < t->in_level[level]; i++) {
        struct kiln_box *box = &t->boxes[t->first[level] + i];
        *box = kiln_box_empty();
        for (size_t child = CHILDREN * i; child < CHILDREN * (i + 1) && child < below; child++) {
            const struct kiln_box inner =
                level == 0 ? box_of(&t->edges[t->order[child]]) : t->boxes[t->first[level - 1] + child];
            kiln_box_join(box, &inner);
        }
    }
}

static int build_levels(struct kiln_edge_tree *t, struct kiln_error *error)
{
    size_t total = 0;
    for (size_t below = t->count; t->level_count == 0 || below > 1; t->level_count++) {
        below = (below + CHILDREN - 1) / CHILDREN;
        t->first[t->level_count] = total;
        t->in_level[t->level_count] = below;
        total += below;
    }
    const int status = kiln_allocate(&t->boxes, total, sizeof *t->boxes, "the tree of edges", error);
    for (size_t level = 0; status == KILN_OK && level < t->level_count; level++)
        fill_level(t, level);
    return status;
}

int kiln_edge_tree_create(struct kiln_edge_tree **tree, const struct kiln_edge *edges, size_t count,
                          struct kiln_error *error)
{
    int status = kiln_allocate(tree, 1, sizeof **tree, "the tree of edges", error);
    if (status != KILN_OK)
        return status;
    (*tree)->edges = edges;
    (*tree)->count = count;
    status = sort_edges(*tree, error);
    if (status == KILN_OK)
        status = build_levels(*tree, error);
    if (status != KILN_OK)
        kiln_edge_tree_destroy(tree);
    return status;
}

void kiln_edge_tree_destroy(struct kiln_edge_tree **tree)
{
    if (*tree == NULL)
        return;
    kiln_free(&(*tree)->order);
    kiln_free(&(*tree)->boxes);
    kiln_free(tree);
}

/* ---- search ---- */

struct visitor {
    struct kiln_box box;
    void (*visit)(void *, size_t);
    void *context;
};

static bool is_near(const struct kiln_box *a, const struct kiln_box *b)
{
    bool near = true;
    for (int c = 0; c < 3; c++)
        near &= a->low[c] <= b->high[c] && b->low[c] <= a->high[c];
    return near;
}

static void descend(const struct kiln_edge_tree *t, const struct visitor *v, size_t level, size_t node)
{
    if (!is_near(&t->boxes[t->first[level] + node], &v->box))
        return;
    const size_t below = level == 0 ? t->count : t->in_level[level - 1];
    for (size_t child = CHILDREN * node; child < CHILDREN * (node + 1) && child < below; child++) {
        if (level > 0) {
            descend(t, v, level - 1, child);
            continue;
        }
        const struct kiln_box box = box_of(&t->edges[t->order[child]]);
        if (is_near(&box, &v->box))
            v->visit(v->context, t->order[child]);
    }
}

void kiln_edge_tree_visit(const struct kiln_edge_tree *tree, const struct kiln_edge *edge, float gap,
                          void (*visit)(void *, size_t), void *context)
{
    struct visitor visitor = {.box = box_of(edge), .visit = visit, .context = context};
    kiln_box_widen(&visitor.box, gap);
    descend(tree, &visitor, tree->level_count - 1, 0);
}
