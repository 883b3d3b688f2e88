#include "worker/light/targets.h"

#include <float.h>
#include <math.h>

#include "shaders/shared/area_light.h"
#include "shaders/shared/warp.h"
#include "worker/base/arena.h"
#include "worker/base/memory.h"
#include "worker/scene/footprint.h"
#include "worker/scene/gloss.h"

#define SLACK 1e-4     /* of a radius or box, for rounding */
#define ROUNDING 4.0   /* multiple of the float rounding of positions in the scene, to be added */
#define WORTH 0.9      /* largest outline of the parts, over that of the whole, with which a cut pays */
#define BOX_LEAST 1e-9 /* sr: least solid angle of a box that is numerically precise */
/* Share of a target's rays that are uniform over its triangles, as a multiple of the mean squared sine between shading
 * and geometric normals; below EVEN_LEAST it is 0. */
#define EVEN_A_SQUARE 1.5
#define EVEN_LEAST 0.02
#define EVEN_MOST 0.2

enum { ABOUT_AN_AXIS = 3 };

/* ---- boxes ---- */

struct box {
    double low[ABOUT_AN_AXIS], high[ABOUT_AN_AXIS];
};

static const struct box nothing = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};

static void widen(struct box *box, struct kiln_dvec3 p)
{
    const double at[] = {p.x, p.y, p.z};
    for (int i = 0; i < ABOUT_AN_AXIS; i++) {
        box->low[i] = fmin(box->low[i], at[i]);
        box->high[i] = fmax(box->high[i], at[i]);
    }
}

static void join(struct box *box, const struct box *other)
{
    for (int i = 0; i < ABOUT_AN_AXIS; i++) {
        box->low[i] = fmin(box->low[i], other->low[i]);
        box->high[i] = fmax(box->high[i], other->high[i]);
    }
}

static void widen_by_triangle(struct box *box, const struct kiln_geometry *g, uint32_t triangle)
{
    struct kiln_vec3 corner[3];
    kiln_geometry_corners(g, triangle, corner);
    for (int c = 0; c < 3; c++)
        widen(box, dvec3_of(corner[c]));
}

/* Least number of triangles that all threads look at together. The results are minima and maxima: the same bits. */
enum { TOGETHER = 1 << 13 };

/* The box of triangles. */
static struct box box_of(const struct kiln_geometry *g, const uint32_t *triangles, size_t count)
{
    struct box all = nothing;
#pragma omp parallel if (count >= TOGETHER)
    {
        struct box own = nothing;
#pragma omp for schedule(static) nowait
        for (size_t i = 0; i < count; i++)
            widen_by_triangle(&own, g, triangles[i]);
#pragma omp critical(kiln_targets)
        join(&all, &own);
    }
    return all;
}

static struct kiln_dvec3 middle_of(const struct box *box)
{
    return dvec3(0.5 * (box->low[0] + box->high[0]), 0.5 * (box->low[1] + box->high[1]),
                 0.5 * (box->low[2] + box->high[2]));
}

/* m2: mean projected area of a box over all directions (Cauchy: a quarter of its surface). */
static double mean_shade(double x, double y, double z) { return 0.5 * (x * y + y * z + z * x); }

static double box_shade(const struct box *box)
{
    return box->low[0] <= box->high[0]
               ? mean_shade(box->high[0] - box->low[0], box->high[1] - box->low[1], box->high[2] - box->low[2])
               : 0.0;
}

/* ---- cuts ---- */

/* A node with triangles [first, end) of the list. They form one target, or two parts: node `parts` and the next one. */
struct node {
    size_t first, end, parts; /* parts 0: it is whole */
    uint32_t object;
    bool stays; /* it cannot be cut */
    struct box box;
    double outline, least; /* m2: outline of the whole; the smaller one of the whole and its parts */
};

struct cutting {
    const struct kiln_geometry *geometry;
    uint32_t *triangles;
    struct node *nodes;
    size_t count;
};

static double centre_of(const struct kiln_geometry *g, uint32_t triangle, int axis)
{
    struct kiln_vec3 corner[3];
    double sum = 0.0;
    kiln_geometry_corners(g, triangle, corner);
    for (int c = 0; c < 3; c++)
        sum += (double)(axis == 0 ? corner[c].x : axis == 1 ? corner[c].y : corner[c].z);
    return sum / 3.0;
}

static double radius_about(const struct cutting *w, const struct node *n, struct kiln_dvec3 centre)
{
    double radius = 0.0;
#pragma omp parallel for schedule(static) reduction(max : radius) if (n->end - n->first >= TOGETHER)
    for (size_t i = n->first; i < n->end; i++) {
        struct kiln_vec3 corner[3];
        kiln_geometry_corners(w->geometry, w->triangles[i], corner);
        for (int c = 0; c < 3; c++)
            radius = fmax(radius, dvec3_length(dvec3_sub(dvec3_of(corner[c]), centre)));
    }
    return radius;
}

static void add_node(struct cutting *w, size_t first, size_t end)
{
    struct node *n = &w->nodes[w->count++];
    *n = (struct node){.first = first, .end = end, .stays = end - first < 2};
    n->object = w->geometry->records[w->triangles[first]].object;
    n->box = box_of(w->geometry, w->triangles + first, end - first);
    const double radius = radius_about(w, n, middle_of(&n->box));
    n->outline = fmin(KILN_PI * radius * radius, box_shade(&n->box));
}

/* Returns the mean projected area of both sides of a node cut at `middle` of the axis, m2; INFINITY: one side is empty.
 */
static double try_cut(const struct cutting *w, const struct node *n, int axis, double middle)
{
    struct box sides[2] = {nothing, nothing};
#pragma omp parallel if (n->end - n->first >= TOGETHER)
    {
        struct box own[2] = {nothing, nothing};
#pragma omp for schedule(static) nowait
        for (size_t i = n->first; i < n->end; i++)
            widen_by_triangle(&own[centre_of(w->geometry, w->triangles[i], axis) < middle ? 0 : 1], w->geometry,
                              w->triangles[i]);
#pragma omp critical(kiln_targets)
        for (int k = 0; k < 2; k++)
            join(&sides[k], &own[k]);
    }
    return sides[0].low[0] <= sides[0].high[0] && sides[1].low[0] <= sides[1].high[0]
               ? box_shade(&sides[0]) + box_shade(&sides[1])
               : INFINITY;
}

/* Cuts a node in two, unless all its triangles have the same centre. */
static void cut(struct cutting *w, struct node *n)
{
    double best = INFINITY, where = 0.0;
    int along = 0;
    for (int axis = 0; axis < ABOUT_AN_AXIS; axis++) {
        double low = INFINITY, high = -INFINITY;
#pragma omp parallel for schedule(static) reduction(min : low) reduction(max : high) if (n->end - n->first >= TOGETHER)
        for (size_t i = n->first; i < n->end; i++) {
            const double centre = centre_of(w->geometry, w->triangles[i], axis);
            low = fmin(low, centre);
            high = fmax(high, centre);
        }
        const double middle = 0.5 * (low + high), left = try_cut(w, n, axis, middle);
        if (left < best) {
            best = left;
            where = middle;
            along = axis;
        }
    }
    n->stays = best == INFINITY;
    size_t next = n->first;
    for (size_t i = n->first; i < n->end && !n->stays; i++)
        if (centre_of(w->geometry, w->triangles[i], along) < where) {
            const uint32_t triangle = w->triangles[i];
            w->triangles[i] = w->triangles[next];
            w->triangles[next++] = triangle;
        }
    if (n->stays)
        return;
    n->parts = w->count;
    add_node(w, n->first, next);
    add_node(w, next, n->end);
}

/* The largest node that can be cut; NULL: none. */
static struct node *largest(const struct cutting *w)
{
    struct node *found = NULL;
    for (size_t i = 0; i < w->count; i++)
        if (w->nodes[i].parts == 0 && !w->nodes[i].stays && w->nodes[i].outline > 0.0 &&
            (found == NULL || w->nodes[i].outline > found->outline))
            found = &w->nodes[i];
    return found;
}

/* Cuts nodes while there are fewer than `most`, and then undoes cuts that do not pay. */
static void cut_all(struct cutting *w, size_t most)
{
    struct node *n;
    for (size_t whole = w->count; whole < most && (n = largest(w)) != NULL;) {
        cut(w, n);
        whole += n->parts != 0;
    }
    for (size_t i = w->count; i-- > 0;) { /* parts come after what they are of */
        n = &w->nodes[i];
        n->least = n->outline;
        if (n->parts == 0)
            continue;
        const double parts = w->nodes[n->parts].least + w->nodes[n->parts + 1].least;
        if (parts <= WORTH * n->outline)
            n->least = parts;
        else
            n->parts = 0;
    }
}

/* ---- targets ---- */

static bool is_taken(const struct kiln_lights *l, size_t triangle)
{
    const struct kiln_hit_record *record = &l->geometry->records[triangle];
    return kiln_gloss_taken(l->scene, record->material & KILN_RECORD_MATERIAL) != NULL &&
           (l->scene->objects[record->object].flags & KILN_OBJECT_RECEIVER_ONLY) == 0;
}

/* m2, of a world triangle. */
static double area_of(const struct kiln_geometry *g, uint32_t triangle)
{
    struct kiln_vec3 corner[3];
    kiln_geometry_corners(g, triangle, corner);
    return 0.5 * dvec3_length(dvec3_cross(dvec3_sub(dvec3_of(corner[1]), dvec3_of(corner[0])),
                                          dvec3_sub(dvec3_of(corner[2]), dvec3_of(corner[0]))));
}

/* Mean squared sine between a triangle's normal and its corners' normals. */
static double lean_of(const struct kiln_lights *l, uint32_t triangle)
{
    static const float corners[3][2] = {{0.0f, 0.0f}, {1.0f, 0.0f}, {0.0f, 1.0f}};
    const struct kiln_dvec3 normal = dvec3_of(kiln_triangle_exact_normal(l->scene, l->geometry, triangle));
    double sum = 0.0;
    for (int c = 0; c < 3; c++) {
        const struct kiln_dvec3 sine = dvec3_cross(
            normal,
            dvec3_of(kiln_triangle_shading_normal(l->scene, l->geometry, triangle, corners[c][0], corners[c][1])));
        sum += dvec3_dot(sine, sine);
    }
    return sum / 3.0;
}

/* Sets the share of a target's rays that are uniform over its triangles, and lists the triangles. */
static void spread(struct kiln_targets *targets, const struct kiln_lights *l, struct kiln_target *t,
                   const uint32_t *triangles, size_t count)
{
    double sum = 0.0, leans = 0.0;
    t->first = (uint32_t)targets->listed;
    for (size_t i = 0; i < count; i++) {
        const double area = area_of(l->geometry, triangles[i]);
        targets->triangles[t->first + i] = triangles[i];
        targets->until[t->first + i] = sum += area;
        leans += area * lean_of(l, triangles[i]);
    }
    const double even = sum > 0.0 ? EVEN_A_SQUARE * leans / sum : 0.0;
    if (even < EVEN_LEAST)
        return;
    t->even = fmin(even, EVEN_MOST);
    t->area = sum;
    t->count = (uint32_t)count;
    targets->listed += count;
    for (size_t i = 0; i < count; i++)
        targets->until[t->first + i] /= sum;
}

/* Adds the target of a node that is whole, or the targets of its parts. */
static void add_targets(const struct cutting *w, const struct kiln_lights *l, const struct node *n, double rounding,
                        struct kiln_targets *targets)
{
    if (n->parts != 0) {
        add_targets(w, l, &w->nodes[n->parts], rounding, targets);
        add_targets(w, l, &w->nodes[n->parts + 1], rounding, targets);
        return;
    }
    const struct box *b = &n->box;
    const struct kiln_dvec3 centre = middle_of(b);
    const double radius = radius_about(w, n, centre), slack = SLACK * radius + rounding;
    for (size_t i = n->first; i < n->end; i++)
        targets->of_triangle[w->triangles[i]] = (uint32_t)targets->count;
    struct kiln_target *t = &targets->all[targets->count++];
    *t = (struct kiln_target){.object = n->object,
                              .centre = centre,
                              .radius = radius + slack,
                              .low = dvec3(b->low[0] - slack, b->low[1] - slack, b->low[2] - slack),
                              .high = dvec3(b->high[0] + slack, b->high[1] + slack, b->high[2] + slack)};
    spread(targets, l, t, w->triangles + n->first, n->end - n->first);
}

/* Sorts the triangles with gloss by object, then by number; `ends`: end of each object's triangles. */
static void sort_triangles(const struct kiln_lights *l, uint32_t *triangles, size_t *ends)
{
    size_t sum = 0;
    for (size_t t = 0; t < l->geometry->triangle_count; t++)
        ends[l->geometry->records[t].object] += is_taken(l, t);
    for (size_t o = 0; o < l->scene->object_count; o++) {
        const size_t count = ends[o];
        ends[o] = sum;
        sum += count;
    }
    for (size_t t = 0; t < l->geometry->triangle_count; t++)
        if (is_taken(l, t))
            triangles[ends[l->geometry->records[t].object]++] = (uint32_t)t;
}

/* The nodes of whole objects. */
static void begin(struct cutting *w, size_t objects, const size_t *ends)
{
    for (size_t o = 0, first = 0; o < objects; first = ends[o++])
        if (ends[o] > first)
            add_node(w, first, ends[o]);
}

static size_t count_taken(const struct kiln_lights *l)
{
    size_t count = 0;
    for (size_t t = 0; t < l->geometry->triangle_count; t++)
        count += is_taken(l, t);
    return count;
}

int kiln_targets_create(struct kiln_targets *targets, const struct kiln_lights *lights, size_t most,
                        struct kiln_error *error)
{
    const struct kiln_geometry *g = lights->geometry;
    const char *what = "the targets of light paths";
    const size_t taken = count_taken(lights), objects = lights->scene->object_count,
                 room = most > objects ? most : objects;
    struct cutting w = {.geometry = g};
    size_t *ends = NULL;
    *targets = (struct kiln_targets){.count = 0};
    if (taken == 0)
        return KILN_OK;
    int status;
    KILN_TRY(kiln_allocate(&w.triangles, taken, sizeof *w.triangles, what, error));
    KILN_TRY(kiln_allocate(&w.nodes, 2 * room, sizeof *w.nodes, what, error));
    KILN_TRY(kiln_allocate(&ends, objects, sizeof *ends, what, error));
    KILN_TRY(kiln_arena_allocate(&targets->arena, &targets->all, room, sizeof *targets->all, what, error));
    KILN_TRY(kiln_arena_allocate(&targets->arena, &targets->of_triangle, g->triangle_count,
                                 sizeof *targets->of_triangle, what, error));
    KILN_TRY(kiln_arena_allocate(&targets->arena, &targets->triangles, taken, sizeof *targets->triangles, what, error));
    KILN_TRY(kiln_arena_allocate(&targets->arena, &targets->until, taken, sizeof *targets->until, what, error));
    const struct kiln_vec3 low = g->bounds_min, high = g->bounds_max;
    const double far = (double)fmaxf(vec3_length(low), vec3_length(high));
    for (size_t t = 0; t < g->triangle_count; t++)
        targets->of_triangle[t] = KILN_NONE;
    sort_triangles(lights, w.triangles, ends);
    begin(&w, objects, ends);
    const size_t whole = w.count;
    cut_all(&w, most);
    for (size_t i = 0; i < whole; i++)
        add_targets(&w, lights, &w.nodes[i], ROUNDING * (double)FLT_EPSILON * far, targets);
end:
    kiln_free(&ends);
    kiln_free(&w.nodes);
    kiln_free(&w.triangles);
    return status;
}

void kiln_targets_release(struct kiln_targets *targets)
{
    kiln_arena_release(&targets->arena);
    targets->count = targets->listed = 0;
}

uint32_t kiln_targets_pick(const struct kiln_targets *targets, const struct kiln_target *target, double pick)
{
    size_t low = target->first, high = target->first + target->count - 1;
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if (targets->until[middle] > pick)
            high = middle;
        else
            low = middle + 1;
    }
    return targets->triangles[low];
}

/* ---- from afar ---- */

double kiln_target_mean_outline(const struct kiln_target *target)
{
    const struct kiln_dvec3 size = dvec3_sub(target->high, target->low);
    return fmin(kiln_target_disc(target), mean_shade(size.x, size.y, size.z));
}

/* ---- from a place ---- */

/* Adds a visible side of the box. `to`: its corner; then its edges, and its distance. */
static bool add_side(struct kiln_box_seen *seen, struct kiln_dvec3 to, struct kiln_dvec3 a, struct kiln_dvec3 b,
                     double height)
{
    const double area = 0.5 * dvec3_length(a) * dvec3_length(b);
    const struct kiln_spherical_triangle half[2] = {kiln_spherical_triangle_of(to, a, b, area, height),
                                                    kiln_spherical_triangle_of(dvec3_add(to, dvec3_add(a, b)),
                                                                               dvec3_scale(a, -1.0),
                                                                               dvec3_scale(b, -1.0), area, height)};
    for (int i = 0; i < 2; i++) {
        if (!(half[i].omega > 0.0) || !kiln_target_is_apart(half[i]))
            return false;
        seen->parts[seen->count++] = half[i];
        seen->omega += half[i].omega;
    }
    return true;
}

bool kiln_target_see_box(const struct kiln_target *t, struct kiln_dvec3 from, double most, struct kiln_box_seen *seen)
{
    const struct kiln_dvec3 low = dvec3_sub(t->low, from), high = dvec3_sub(t->high, from), size = dvec3_sub(high, low);
    const struct kiln_dvec3 x = dvec3(size.x, 0, 0), y = dvec3(0, size.y, 0), z = dvec3(0, 0, size.z);
    bool is_seen = true;
    seen->count = 0;
    seen->omega = 0.0;
    if (low.x > 0.0 || high.x < 0.0)
        is_seen =
            add_side(seen, dvec3(low.x > 0.0 ? low.x : high.x, low.y, low.z), y, z, low.x > 0.0 ? low.x : -high.x);
    if (is_seen && (low.y > 0.0 || high.y < 0.0))
        is_seen =
            add_side(seen, dvec3(low.x, low.y > 0.0 ? low.y : high.y, low.z), z, x, low.y > 0.0 ? low.y : -high.y);
    if (is_seen && (low.z > 0.0 || high.z < 0.0))
        is_seen =
            add_side(seen, dvec3(low.x, low.y, low.z > 0.0 ? low.z : high.z), x, y, low.z > 0.0 ? low.z : -high.z);
    return is_seen && seen->omega > BOX_LEAST && seen->omega < most;
}

struct kiln_dvec3 kiln_box_direction(const struct kiln_box_seen *seen, double pick, double u, double v)
{
    double left = pick * seen->omega;
    size_t i = 0;
    while (i + 1 < seen->count && left >= seen->parts[i].omega)
        left -= seen->parts[i++].omega;
    return kiln_spherical_triangle_direction(seen->parts[i], u, v);
}
