#include "worker/light/tree.h"

#include <assert.h>
#include <float.h>
#include <stdlib.h>

#include "worker/base/memory.h"

static struct kiln_dvec3 dmin(struct kiln_dvec3 a, struct kiln_dvec3 b)
{
    return dvec3(fmin(a.x, b.x), fmin(a.y, b.y), fmin(a.z, b.z));
}
static struct kiln_dvec3 dmax(struct kiln_dvec3 a, struct kiln_dvec3 b)
{
    return dvec3(fmax(a.x, b.x), fmax(a.y, b.y), fmax(a.z, b.z));
}
static double component(struct kiln_dvec3 a, int axis) { return axis == 0 ? a.x : axis == 1 ? a.y : a.z; }
static struct kiln_dvec3 centre_of(const struct kiln_light_node *n)
{
    return dvec3_scale(dvec3_add(n->minimum, n->maximum), 0.5);
}

static struct kiln_light_node leaf_of(const struct kiln_lights *lights, uint32_t index)
{
    struct kiln_light_node node = {.left = KILN_NONE, .right = index};
    if (index < lights->area_count) {
        const struct kiln_area_light *a = &lights->areas[index];
        const struct kiln_dvec3 p1 = dvec3_add(a->p0, a->e1), p2 = dvec3_add(a->p0, a->e2);
        node.minimum = dmin(a->p0, dmin(p1, p2));
        node.maximum = dmax(a->p0, dmax(p1, p2));
        node.axis = a->normal;
        node.cos_o = 1.0;
        node.cos_e = 0.0;
        node.two_sided = a->two_sided;
        node.power = kiln_luminance_of_floats(a->radiance) * a->area;
    } else {
        const struct kiln_point_light *l = &lights->points[index - lights->area_count];
        node.minimum = node.maximum = l->position;
        node.axis = l->spot ? l->direction : dvec3(0, 0, 1);
        node.cos_o = l->spot ? 1.0 : -1.0;
        node.cos_e = l->spot ? l->cos_outer : 0.0;
        node.power = kiln_luminance_of_floats(l->intensity);
    }
    return node;
}

/* Smallest cone that contains both (pbrt-v4 section 3.8.4: Union of DirectionCones). */
static void merge_cones(const struct kiln_light_node *a, const struct kiln_light_node *b, struct kiln_light_node *out)
{
    out->cos_e = fmin(a->cos_e, b->cos_e);
    const double theta_a = acos(fmax(-1.0, fmin(1.0, a->cos_o))), theta_b = acos(fmax(-1.0, fmin(1.0, b->cos_o)));
    const double between = acos(fmax(-1.0, fmin(1.0, dvec3_dot(a->axis, b->axis))));
    if (fmin(between + theta_b, KILN_PI) <= theta_a) {
        out->axis = a->axis;
        out->cos_o = a->cos_o;
        return;
    }
    if (fmin(between + theta_a, KILN_PI) <= theta_b) {
        out->axis = b->axis;
        out->cos_o = b->cos_o;
        return;
    }
    const double theta = 0.5 * (theta_a + theta_b + between);
    const struct kiln_dvec3 around = dvec3_cross(a->axis, b->axis);
    const double length = dvec3_length(around);
    if (theta >= KILN_PI || length < 1e-12) {
        out->axis = a->axis;
        out->cos_o = -1.0;
        return;
    }
    /* turn a's axis towards b's by theta - theta_a: Rodrigues with a perpendicular axis */
    const double turn = theta - theta_a;
    const struct kiln_dvec3 k = dvec3_scale(around, 1.0 / length);
    out->axis = dvec3_add(dvec3_scale(a->axis, cos(turn)), dvec3_scale(dvec3_cross(k, a->axis), sin(turn)));
    out->cos_o = cos(theta);
}

static struct kiln_light_node merge(const struct kiln_light_node *a, const struct kiln_light_node *b)
{
    struct kiln_light_node out = {0};
    out.minimum = dmin(a->minimum, b->minimum);
    out.maximum = dmax(a->maximum, b->maximum);
    out.power = a->power + b->power;
    out.two_sided = a->two_sided || b->two_sided;
    merge_cones(a, b, &out);
    return out;
}

/* ---- building ---- */

struct sort_key {
    double key;
    uint32_t leaf;
};

static bool is_before(struct sort_key a, struct sort_key b) { return a.key != b.key ? a.key < b.key : a.leaf < b.leaf; }

static int by_key(const void *a, const void *b)
{
    const struct sort_key x = *(const struct sort_key *)a, y = *(const struct sort_key *)b;
    return is_before(x, y) ? -1 : is_before(y, x);
}

static struct sort_key middle_of(struct sort_key a, struct sort_key b, struct sort_key c)
{
    const struct sort_key low = is_before(b, a) ? b : a, high = is_before(b, a) ? a : b;
    return is_before(c, low) ? low : is_before(high, c) ? high : c;
}

/* Moves the `half` smallest keys to the front. No keys are equal, so the result does not depend on the method. */
static void split_keys(struct sort_key *keys, size_t count, size_t half)
{
    size_t low = 0, high = count; /* keys between them are not in their half yet */
    for (int steps = 0; high - low > 32 && low < half && half < high; steps++) {
        if (steps == 64) { /* they were unlucky each time */
            qsort(keys + low, high - low, sizeof *keys, by_key);
            return;
        }
        const struct sort_key pivot = middle_of(keys[low], keys[low + (high - low) / 2], keys[high - 1]);
        size_t i = low, j = high - 1;
        for (;; i++, j--) {
            while (is_before(keys[i], pivot))
                i++;
            while (is_before(pivot, keys[j]))
                j--;
            if (i >= j)
                break;
            const struct sort_key moved = keys[i];
            keys[i] = keys[j];
            keys[j] = moved;
        }
        /* keys before i are at most the pivot, those from i on at least */
        if (half <= i)
            high = i;
        else
            low = i;
    }
    if (low < half && half < high)
        qsort(keys + low, high - low, sizeof *keys, by_key);
}

struct tree_builder {
    struct kiln_light_node *leaves;
    struct kiln_light_node *nodes;
    struct sort_key *keys;
};

enum { TASK_LEAVES = 512 }; /* the least that is worth a task of its own */

/* Builds the nodes of a range of lights: cuts along the longest side of the centres' box at the median, for a balanced
 * tree with a depth near log2. `count` lights have 2 count - 1 nodes from `index` on, the left subtree first. */
static void build_range(const struct tree_builder *b, size_t index, size_t first, size_t count)
{
    if (count == 1) {
        b->nodes[index] = b->leaves[b->keys[first].leaf];
        return;
    }
    struct kiln_dvec3 low = dvec3(DBL_MAX, DBL_MAX, DBL_MAX), high = dvec3(-DBL_MAX, -DBL_MAX, -DBL_MAX);
    for (size_t i = first; i < first + count; i++) {
        const struct kiln_dvec3 c = centre_of(&b->leaves[b->keys[i].leaf]);
        low = dmin(low, c);
        high = dmax(high, c);
    }
    const struct kiln_dvec3 size = dvec3_sub(high, low);
    const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
    for (size_t i = first; i < first + count; i++)
        b->keys[i].key = component(centre_of(&b->leaves[b->keys[i].leaf]), axis);
    const size_t half = count / 2, left = index + 1, right = index + 2 * half;
    split_keys(b->keys + first, count, half);
#pragma omp task if (count > TASK_LEAVES)
    build_range(b, left, first, half);
    build_range(b, right, first + half, count - half);
#pragma omp taskwait
    b->nodes[index] = merge(&b->nodes[left], &b->nodes[right]);
    b->nodes[index].left = (uint32_t)left;
    b->nodes[index].right = (uint32_t)right;
}

static void build(const struct kiln_lights *lights, const struct tree_builder *b, uint32_t count)
{
#pragma omp parallel if (count > TASK_LEAVES)
    {
#pragma omp for
        for (uint32_t i = 0; i < count; i++) {
            b->leaves[i] = leaf_of(lights, i);
            b->keys[i].leaf = i;
        }
#pragma omp single
        build_range(b, 0, 0, count);
    }
}

int kiln_light_tree_build(struct kiln_lights *lights, struct kiln_error *error)
{
    const size_t count = lights->area_count + lights->point_count;
    if (count == 0)
        return KILN_OK;
    struct tree_builder b = {0};
    int status;
    KILN_TRY(kiln_allocate_bare(&b.leaves, count, sizeof *b.leaves, "the light tree's leaves", error));
    KILN_TRY(kiln_allocate_bare(&b.keys, count, sizeof *b.keys, "the light tree's order", error));
    KILN_TRY(kiln_allocate_bare(&lights->nodes, 2 * count - 1, sizeof *lights->nodes, "the light tree", error));
    kiln_expect_whole(b.leaves, count, sizeof *b.leaves);
    kiln_expect_whole(lights->nodes, 2 * count - 1, sizeof *lights->nodes);
    b.nodes = lights->nodes;
    build(lights, &b, (uint32_t)count);
    lights->node_count = 2 * count - 1;
end:
    kiln_free(&b.leaves);
    kiln_free(&b.keys);
    return status;
}

/* Inline, because it is called for every node that a point tests, and most members are usually unused. */
static inline __attribute__((always_inline)) struct kiln_light_bounds bounds_of(const struct kiln_light_node *node)
{
    const struct kiln_dvec3 half = dvec3_scale(dvec3_sub(node->maximum, node->minimum), 0.5);
    return (struct kiln_light_bounds){.centre = centre_of(node),
                                      .axis = node->axis,
                                      .radius = dvec3_length(half),
                                      .floor2 = 0.25 * dvec3_dot(half, half),
                                      .cos_o = node->cos_o,
                                      .sin_o = kiln_sine_of_cosine(node->cos_o),
                                      .cos_e = node->cos_e,
                                      .power = node->power,
                                      .two_sided = node->two_sided,
                                      .shines = node->power > 0.0};
}

struct kiln_light_bounds kiln_light_bounds_of(const struct kiln_light_node *node) { return bounds_of(node); }

double kiln_light_node_importance(const struct kiln_light_node *node, struct kiln_dvec3 p, double spread,
                                  struct kiln_dvec3 n)
{
    return kiln_light_importance(bounds_of(node), p, spread, n);
}
