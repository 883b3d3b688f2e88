#include "coordinator/import/obj_polygon.h"

#include <math.h>

#include "worker/base/memory.h"

int obj_polygon_room(struct obj_polygon *p, size_t count, struct kiln_error *error)
{
    const struct {
        void *pointer;
        size_t size;
    } columns[] = {{&p->points, sizeof *p->points},
                   {&p->flat, sizeof *p->flat},
                   {&p->ring, sizeof *p->ring},
                   {&p->reflex, sizeof *p->reflex},
                   {&p->triangles, 3 * sizeof *p->triangles}};
    size_t capacity = p->capacity;
    for (size_t i = 0; i < sizeof columns / sizeof columns[0]; i++) {
        capacity = p->capacity;
        const int status =
            kiln_grow(columns[i].pointer, &capacity, count, columns[i].size, "the corners of a face", error);
        if (status != KILN_OK)
            return status;
    }
    p->capacity = capacity;
    return KILN_OK;
}

void obj_polygon_destroy(struct obj_polygon *p)
{
    kiln_free(&p->points);
    kiln_free(&p->flat);
    kiln_free(&p->ring);
    kiln_free(&p->reflex);
    kiln_free(&p->triangles);
    p->capacity = 0;
}

/* Twice the polygon's area, as a vector along its normal (Newell's method), from differences to the first corner. */
static struct kiln_dvec3 area_vector(const struct kiln_dvec3 *points, size_t count)
{
    struct kiln_dvec3 sum = dvec3(0.0, 0.0, 0.0);
    const struct kiln_dvec3 first = points[0];
    for (size_t i = 1; i + 1 < count; i++)
        sum = dvec3_add(sum, dvec3_cross(dvec3_sub(points[i], first), dvec3_sub(points[i + 1], first)));
    return sum;
}

/* Projects to 2D by leaving out the coordinate along which the area is largest, so that the polygon winds
 * counter-clockwise. */
static void flatten(struct obj_polygon *p, size_t count)
{
    const struct kiln_dvec3 area = area_vector(p->points, count);
    const double x = fabs(area.x), y = fabs(area.y), z = fabs(area.z);
    for (size_t i = 0; i < count; i++) {
        const struct kiln_dvec3 v = p->points[i];
        const double *axes[3] = {&v.x, &v.y, &v.z};
        const unsigned left_out = x >= y && x >= z ? 0 : y >= z ? 1 : 2;
        const bool forward = (left_out == 0 ? area.x : left_out == 1 ? area.y : area.z) >= 0.0;
        p->flat[i][forward ? 0 : 1] = *axes[(left_out + 1) % 3];
        p->flat[i][forward ? 1 : 0] = *axes[(left_out + 2) % 3];
    }
}

/* Twice the signed area of three corners. */
static double turn(const struct obj_polygon *p, uint32_t a, uint32_t b, uint32_t c)
{
    const double *o = p->flat[a], *u = p->flat[b], *v = p->flat[c];
    return (u[0] - o[0]) * (v[1] - o[1]) - (u[1] - o[1]) * (v[0] - o[0]);
}

static bool same_place(const struct obj_polygon *p, uint32_t a, uint32_t b)
{
    return p->flat[a][0] == p->flat[b][0] && p->flat[a][1] == p->flat[b][1];
}

static bool within(const struct obj_polygon *p, uint32_t a, uint32_t b, uint32_t c, uint32_t point)
{
    return !same_place(p, point, a) && !same_place(p, point, b) && !same_place(p, point, c) &&
           turn(p, a, b, point) >= 0.0 && turn(p, b, c, point) >= 0.0 && turn(p, c, a, point) >= 0.0;
}

/* Whether corner i is an ear: convex, and its triangle holds no reflex corner, so no corner at all. */
static bool is_ear(const struct obj_polygon *p, uint32_t i)
{
    const uint32_t before = p->ring[i].previous, after = p->ring[i].next;
    if (!(turn(p, before, i, after) > 0.0))
        return false;
    for (size_t k = 0; k < p->reflex_count; k++)
        if (p->ring[p->reflex[k]].reflex && within(p, before, i, after, p->reflex[k]))
            return false;
    return true;
}

static void find_reflex(struct obj_polygon *p, uint32_t count)
{
    p->reflex_count = 0;
    for (uint32_t i = 0; i < count; i++) {
        p->ring[i] = (struct obj_corner){.next = i + 1 == count ? 0 : i + 1, .previous = i == 0 ? count - 1 : i - 1};
        p->ring[i].reflex = turn(p, p->ring[i].previous, i, p->ring[i].next) < 0.0;
        if (p->ring[i].reflex)
            p->reflex[p->reflex_count++] = i;
    }
}

/* Updates a corner after a neighbour has been cut off. */
static void update_corner(struct obj_polygon *p, uint32_t i)
{
    p->ring[i].reflex = p->ring[i].reflex && turn(p, p->ring[i].previous, i, p->ring[i].next) < 0.0;
    p->ring[i].ear = is_ear(p, i);
}

static void emit(struct obj_polygon *p, size_t *triangle, uint32_t a, uint32_t b, uint32_t c)
{
    uint32_t *corner = p->triangles + 3 * (*triangle)++;
    corner[0] = a, corner[1] = b, corner[2] = c;
}

static void clip_ears(struct obj_polygon *p, uint32_t count)
{
    size_t triangle = 0;
    uint32_t at = 0, left = count, tried = 0;
    /* upper bound of the steps for a polygon of OBJ_CONCAVE_MAX corners */
    uint64_t steps_left = 2 * (uint64_t)OBJ_CONCAVE_MAX * OBJ_CONCAVE_MAX + count;
    for (uint32_t i = 0; i < count; i++)
        p->ring[i].ear = is_ear(p, i);
    while (left > 3) {
        /* a polygon without an ear crosses itself or is degenerate; it is cut into a fan */
        if (!p->ring[at].ear && tried++ < left && steps_left > 0) {
            steps_left--;
            at = p->ring[at].next;
            continue;
        }
        const uint32_t before = p->ring[at].previous, after = p->ring[at].next;
        emit(p, &triangle, before, at, after);
        p->ring[before].next = after;
        p->ring[after].previous = before;
        update_corner(p, before);
        update_corner(p, after);
        at = after;
        left--;
        tried = 0;
    }
    emit(p, &triangle, p->ring[at].previous, at, p->ring[at].next);
}

static void cut_quadrilateral(struct obj_polygon *p)
{
    size_t triangle = 0;
    const uint32_t first = p->reflex_count == 0 ? 0 : p->reflex[0];
    emit(p, &triangle, first, (first + 1) % 4, (first + 2) % 4);
    emit(p, &triangle, first, (first + 2) % 4, (first + 3) % 4);
}

bool obj_polygon_cut(struct obj_polygon *p, size_t count)
{
    size_t triangle = 0;
    if (count == 3) {
        emit(p, &triangle, 0, 1, 2);
        return true;
    }
    flatten(p, count);
    find_reflex(p, (uint32_t)count);
    if (p->reflex_count > 0 && count > OBJ_CONCAVE_MAX)
        return false;
    if (count == 4)
        cut_quadrilateral(p);
    else
        clip_ears(p, (uint32_t)count);
    return true;
}
