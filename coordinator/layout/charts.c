#include "coordinator/layout/charts.h"

#include <stdlib.h>
#include <string.h>

#include "coordinator/layout/raster.h"
#include "coordinator/layout/segment.h"
#include "worker/base/arena.h"
#include "worker/base/memory.h"

enum { SAMPLES_A_TEXEL = 8, SAMPLES_MIN = 128, SAMPLES_MAX = 8192, HULL_DIRECTIONS = 256 };

struct point {
    double x, y;
};

struct maker {
    const struct kiln_topology *topology;
    struct kiln_charts *charts;
    double texels_per_metre;
    uint32_t *label; /* per triangle: the number of the candidate it belongs to; split candidates get new numbers */
    uint32_t label_count;
    uint32_t *stamp;      /* per vertex: the label of the candidate that last collected it */
    struct point *points; /* room for one per vertex, and twice as many for the hull */
    uint32_t *queue;      /* room for one per triangle */
    uint32_t *side;       /* per triangle: which half it goes to, while a candidate is split */
    struct kiln_bitmap bitmap;
    struct kiln_arena arena;
};

/* A candidate chart: a range of `order`, with the axis of a cone that holds its normals. It becomes a chart or is
 * split. */
struct candidate {
    uint32_t first, count;
    struct kiln_dvec3 axis;
};

static int compare_points(const void *a, const void *b)
{
    const struct point *p = a, *q = b;
    if (p->x != q->x)
        return p->x < q->x ? -1 : 1;
    return p->y < q->y ? -1 : p->y > q->y;
}

static double turn(const struct point *a, const struct point *b, const struct point *c)
{
    return (b->x - a->x) * (c->y - a->y) - (b->y - a->y) * (c->x - a->x);
}

/* Convex hull (Andrew's monotone chain), counter-clockwise, into hull[]; sorts the points. */
static size_t convex_hull(struct point *points, size_t count, struct point *hull)
{
    qsort(points, count, sizeof *points, compare_points);
    size_t n = 0;
    for (size_t i = 0; i < count; i++) {
        while (n >= 2 && turn(&hull[n - 2], &hull[n - 1], &points[i]) <= 0.0)
            n--;
        hull[n++] = points[i];
    }
    const size_t lower = n + 1;
    for (size_t i = count - 1; i-- > 0;) {
        while (n >= lower && turn(&hull[n - 2], &hull[n - 1], &points[i]) <= 0.0)
            n--;
        hull[n++] = points[i];
    }
    return n > 1 ? n - 1 : n;
}

/* Extent of the hull along the direction (c, s) and perpendicular to it. */
static void hull_extent(const struct point *hull, size_t count, double c, double s, double low[2], double high[2])
{
    low[0] = low[1] = INFINITY;
    high[0] = high[1] = -INFINITY;
    for (size_t i = 0; i < count; i++) {
        const double x = c * hull[i].x + s * hull[i].y, y = c * hull[i].y - s * hull[i].x;
        low[0] = fmin(low[0], x);
        low[1] = fmin(low[1], y);
        high[0] = fmax(high[0], x);
        high[1] = fmax(high[1], y);
    }
}

/* Rotates the chart to the bounding box of least area, which has a side along an edge of the hull. The longer side is
 * put along u, and the box's corner at the origin. */
static void align_chart(struct maker *m, struct kiln_chart *chart, size_t point_count)
{
    struct point *hull = m->points + m->topology->vertex_count;
    const size_t count = convex_hull(m->points, point_count, hull);
    const size_t step = count / HULL_DIRECTIONS + 1;
    double best = INFINITY, best_c = 1.0, best_s = 0.0, low[2], high[2];
    for (size_t i = 0; i < count; i += step) {
        const struct point *a = &hull[i], *b = &hull[(i + 1) % count];
        const double length = hypot(b->x - a->x, b->y - a->y);
        if (!(length > 0.0))
            continue;
        const double c = (b->x - a->x) / length, s = (b->y - a->y) / length;
        hull_extent(hull, count, c, s, low, high);
        const double area = (high[0] - low[0]) * (high[1] - low[1]);
        if (area < best * (1.0 - 1e-9)) {
            best = area;
            best_c = c;
            best_s = s;
        }
    }
    hull_extent(hull, count, best_c, best_s, low, high);
    if (high[1] - low[1] > high[0] - low[0]) {
        const double c = best_c;
        best_c = -best_s;
        best_s = c;
        hull_extent(hull, count, best_c, best_s, low, high);
    }
    const struct kiln_dvec3 u = chart->u, v = chart->v;
    chart->u = dvec3_add(dvec3_scale(u, best_c), dvec3_scale(v, best_s));
    chart->v = dvec3_sub(dvec3_scale(v, best_c), dvec3_scale(u, best_s));
    chart->offset[0] = -low[0];
    chart->offset[1] = -low[1];
    chart->width = high[0] - low[0];
    chart->height = high[1] - low[1];
}

static struct kiln_dvec3 projection_axis(const struct maker *m, const struct candidate *candidate)
{
    const struct kiln_topology *t = m->topology;
    const uint32_t *order = m->charts->order + candidate->first;
    struct kiln_dvec3 sum = dvec3(0.0, 0.0, 0.0);
    for (size_t i = 0; i < candidate->count; i++)
        sum = dvec3_add(sum, dvec3_scale(t->normals[order[i]], t->areas[order[i]]));
    const double length = dvec3_length(sum);
    if (!(length > 0.0))
        return candidate->axis;
    const struct kiln_dvec3 mean = dvec3_scale(sum, 1.0 / length);
    for (size_t i = 0; i < candidate->count; i++)
        if (dvec3_dot(mean, t->normals[order[i]]) < cos(KILN_CHART_CONE))
            return candidate->axis;
    return mean;
}

static void plane_axes(struct kiln_dvec3 n, struct kiln_dvec3 *u, struct kiln_dvec3 *v)
{
    struct kiln_dvec3 along = dvec3(1.0, 0.0, 0.0);
    if (fabs(n.y) <= fabs(n.x) && fabs(n.y) <= fabs(n.z))
        along = dvec3(0.0, 1.0, 0.0);
    else if (fabs(n.z) <= fabs(n.x))
        along = dvec3(0.0, 0.0, 1.0);
    const struct kiln_dvec3 side = dvec3_cross(along, n);
    *u = dvec3_scale(side, 1.0 / dvec3_length(side));
    *v = dvec3_cross(n, *u);
}

/* Computes the plane, scale, rotation and bounding box of a candidate. */
static void project_candidate(struct maker *m, const struct candidate *candidate, struct kiln_chart *chart)
{
    const struct kiln_topology *t = m->topology;
    const uint32_t *order = m->charts->order + candidate->first;
    const struct kiln_dvec3 normal = projection_axis(m, candidate);
    *chart = (struct kiln_chart){.first = candidate->first, .count = candidate->count};
    plane_axes(normal, &chart->u, &chart->v);
    double flat = 0.0;
    for (size_t i = 0; i < candidate->count; i++) {
        chart->area += t->areas[order[i]];
        flat += t->areas[order[i]] * dvec3_dot(t->normals[order[i]], normal);
    }
    const double scale = sqrt(chart->area / flat);
    chart->u = dvec3_scale(chart->u, scale);
    chart->v = dvec3_scale(chart->v, scale);
    const uint32_t stamp = m->label[order[0]] + 1;
    size_t count = 0;
    for (size_t i = 0; i < 3 * (size_t)candidate->count; i++) {
        const uint32_t vertex = t->triangles[3 * (size_t)order[i / 3] + i % 3];
        if (m->stamp[vertex] == stamp)
            continue;
        m->stamp[vertex] = stamp;
        double uv[2];
        kiln_chart_project(chart, t->points[vertex], uv);
        m->points[count++] = (struct point){uv[0], uv[1]};
    }
    align_chart(m, chart, count);
    chart->rectangular = chart->area > 0.9999 * chart->width * chart->height;
}

/* Tests by samples whether the chart's projection overlaps itself. */
static int chart_overlaps(struct maker *m, const struct kiln_chart *chart, bool *overlaps, struct kiln_error *error)
{
    const struct kiln_topology *t = m->topology;
    const double side = fmax(chart->width, chart->height);
    const double across = fmin(fmax(SAMPLES_A_TEXEL * m->texels_per_metre * side, SAMPLES_MIN), SAMPLES_MAX),
                 scale = across / side;
    const int status =
        kiln_bitmap_reset(&m->bitmap, (uint32_t)ceil(across) + 1, (uint32_t)ceil(chart->height * scale) + 1, error);
    if (status != KILN_OK)
        return status;
    uint64_t covered = 0, again = 0;
    for (size_t i = 0; i < chart->count && again == 0; i++) {
        const uint32_t *c = t->triangles + 3 * (size_t)m->charts->order[chart->first + i];
        double corner[3][2];
        for (int k = 0; k < 3; k++) {
            kiln_chart_project(chart, t->points[c[k]], corner[k]);
            corner[k][0] *= scale;
            corner[k][1] *= scale;
        }
        kiln_raster_samples(&m->bitmap, (const double(*)[2])corner, &covered, &again);
    }
    *overlaps = again > 0;
    return KILN_OK;
}

/* Visits the triangles of one label breadth-first, starting with the `filled` triangles in the queue (already marked),
 * until `limit` triangles are reached. Marks `side`. Returns the number of triangles reached. */
static size_t walk(struct maker *m, uint32_t label, size_t filled, size_t limit)
{
    const struct kiln_topology *t = m->topology;
    for (size_t i = 0; i < filled && filled < limit; i++) {
        const uint32_t triangle = m->queue[i];
        for (size_t k = 0; k < 3; k++) {
            const uint32_t other = t->neighbours[3 * (size_t)triangle + k];
            if (other == KILN_NONE || m->label[other] != label || m->side[other] != KILN_NONE)
                continue;
            m->side[other] = m->side[triangle];
            m->queue[filled++] = other;
        }
    }
    return filled;
}

static void clear_sides(struct maker *m, const uint32_t *order, size_t count)
{
    for (size_t i = 0; i < count; i++)
        m->side[order[i]] = KILN_NONE;
}

/* Splits a candidate into two connected halves, by two regions that grow at the same rate from distant triangles. */
static void split_candidate(struct maker *m, const struct candidate *candidate, struct candidate halves[2])
{
    uint32_t *order = m->charts->order + candidate->first;
    const uint32_t label = m->label[order[0]];
    uint32_t far[2] = {order[0], order[0]};
    for (int end = 0; end < 2; end++) {
        clear_sides(m, order, candidate->count);
        m->queue[0] = end == 0 ? order[0] : far[0];
        m->side[m->queue[0]] = 0;
        far[end] = m->queue[walk(m, label, 1, candidate->count) - 1];
    }
    clear_sides(m, order, candidate->count);
    for (uint32_t end = 0; end < 2; end++) {
        m->queue[end] = far[end];
        m->side[far[end]] = end;
    }
    walk(m, label, 2, candidate->count);
    const uint32_t labels[2] = {m->label_count, m->label_count + 1};
    m->label_count += 2;
    uint32_t counts[2] = {0, 0};
    for (size_t i = 0; i < candidate->count; i++)
        if (m->side[order[i]] == 0)
            m->queue[counts[0]++] = order[i];
    for (size_t i = 0; i < candidate->count; i++)
        if (m->side[order[i]] != 0)
            m->queue[counts[0] + counts[1]++] = order[i];
    memcpy(order, m->queue, candidate->count * sizeof *order);
    for (size_t i = 0; i < candidate->count; i++)
        m->label[order[i]] = labels[i >= counts[0]];
    halves[0] = (struct candidate){candidate->first, counts[0], candidate->axis};
    halves[1] = (struct candidate){candidate->first + counts[0], counts[1], candidate->axis};
}

/* Makes charts of one candidate, splitting it as often as needed. */
static int make_charts(struct maker *m, struct candidate whole, struct kiln_error *error)
{
    struct candidate *stack = NULL;
    size_t capacity = 0, depth = 0;
    int status = kiln_grow(&stack, &capacity, 1, sizeof *stack, "charts", error);
    if (status == KILN_OK)
        stack[depth++] = whole;
    while (depth > 0 && status == KILN_OK) {
        const struct candidate candidate = stack[--depth];
        struct kiln_chart chart;
        bool overlaps = false;
        project_candidate(m, &candidate, &chart);
        if (candidate.count > 1)
            status = chart_overlaps(m, &chart, &overlaps, error);
        if (status == KILN_OK)
            status = kiln_grow(&stack, &capacity, depth + 2, sizeof *stack, "charts", error);
        if (status == KILN_OK)
            status = kiln_grow(&m->charts->charts, &m->charts->capacity, m->charts->count + 1,
                               sizeof *m->charts->charts, "charts", error);
        if (status != KILN_OK)
            break;
        if (!overlaps) {
            m->charts->charts[m->charts->count++] = chart;
            continue;
        }
        struct candidate halves[2];
        split_candidate(m, &candidate, halves);
        stack[depth++] = halves[1];
        stack[depth++] = halves[0];
    }
    kiln_free(&stack);
    return status;
}

/* Sorts triangles by segment and labels them. Segment s has the range first[s] .. first[s + 1] of `order`. */
static void order_triangles(struct maker *m, const struct kiln_segments *segments, uint32_t *first)
{
    const size_t count = m->topology->triangle_count;
    for (size_t i = 0; i < count; i++)
        if (segments->segment[i] != KILN_NONE)
            first[segments->segment[i] + 1]++;
    for (size_t s = 0; s < segments->count; s++)
        first[s + 1] += first[s];
    m->charts->order_count = first[segments->count];
    /* the queue has room: there are at most as many segments as triangles */
    memcpy(m->queue, first, segments->count * sizeof *first);
    for (size_t i = 0; i < count; i++) {
        m->label[i] = segments->segment[i];
        if (segments->segment[i] != KILN_NONE)
            m->charts->order[m->queue[segments->segment[i]]++] = (uint32_t)i;
    }
    m->label_count = (uint32_t)segments->count;
}

static int maker_allocate(struct maker *m, struct kiln_error *error)
{
    const size_t triangles = m->topology->triangle_count, vertices = m->topology->vertex_count;
    int status;
    KILN_TRY(kiln_allocate(&m->charts->order, triangles, sizeof *m->charts->order, "charts", error));
    KILN_TRY(kiln_arena_allocate(&m->arena, &m->label, triangles, sizeof *m->label, "charts", error));
    KILN_TRY(kiln_arena_allocate(&m->arena, &m->queue, triangles, sizeof *m->queue, "charts", error));
    KILN_TRY(kiln_arena_allocate(&m->arena, &m->side, triangles, sizeof *m->side, "charts", error));
    KILN_TRY(kiln_arena_allocate(&m->arena, &m->stamp, vertices, sizeof *m->stamp, "charts", error));
    /* While it is built, the hull of n points holds up to 2 n points. */
    KILN_TRY(kiln_arena_allocate(&m->arena, &m->points, 3 * vertices + 2, sizeof *m->points, "charts", error));
end:
    return status;
}

int kiln_charts_create(struct kiln_charts **charts, const struct kiln_topology *topology, double texels_per_metre,
                       struct kiln_error *error)
{
    struct maker m = {.topology = topology, .texels_per_metre = texels_per_metre};
    struct kiln_segments *segments = NULL;
    uint32_t *first = NULL;
    *charts = NULL;
    int status = kiln_allocate(&m.charts, 1, sizeof *m.charts, "charts", error);
    if (status == KILN_OK)
        status = maker_allocate(&m, error);
    if (status == KILN_OK)
        status = kiln_segments_create(&segments, topology, error);
    if (status == KILN_OK)
        status = kiln_allocate(&first, segments->count + 1, sizeof *first, "charts", error);
    if (status == KILN_OK) {
        order_triangles(&m, segments, first);
        for (size_t s = 0; s < segments->count && status == KILN_OK; s++)
            status = make_charts(&m, (struct candidate){first[s], first[s + 1] - first[s], segments->axes[s]}, error);
    }
    kiln_free(&first);
    kiln_segments_destroy(&segments);
    kiln_free(&m.bitmap.words);
    kiln_arena_release(&m.arena);
    if (status != KILN_OK)
        kiln_charts_destroy(&m.charts);
    *charts = m.charts;
    return status;
}

void kiln_charts_destroy(struct kiln_charts **charts)
{
    if (*charts == NULL)
        return;
    kiln_free(&(*charts)->order);
    kiln_free(&(*charts)->charts);
    kiln_free(charts);
}
