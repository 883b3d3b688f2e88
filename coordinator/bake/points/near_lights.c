#include "coordinator/bake/points/near_lights.h"

#include <math.h>

/* The squared distance of a place from the edge a b. */
static double square_to_edge(struct kiln_dvec3 place, struct kiln_dvec3 a, struct kiln_dvec3 b)
{
    const struct kiln_dvec3 edge = dvec3_sub(b, a), to = dvec3_sub(place, a);
    const double square = dvec3_dot(edge, edge);
    const double along = square > 0.0 ? fmin(fmax(dvec3_dot(to, edge) / square, 0.0), 1.0) : 0.0;
    const struct kiln_dvec3 off = dvec3_sub(to, dvec3_scale(edge, along));
    return dvec3_dot(off, off);
}

/* The distance of a place from a triangle; infinite behind a single-sided one. */
static double distance_to(const struct kiln_geometry *g, uint64_t triangle, struct kiln_dvec3 place)
{
    struct kiln_vec3 corner[3];
    kiln_geometry_corners(g, triangle, corner);
    const struct kiln_dvec3 a = dvec3_of(corner[0]), b = dvec3_of(corner[1]), c = dvec3_of(corner[2]),
                            normal = dvec3_cross(dvec3_sub(b, a), dvec3_sub(c, a)), to = dvec3_sub(place, a);
    const double square = dvec3_dot(normal, normal), height = dvec3_dot(normal, to);
    if (!(square > 0.0) || (!(height > 0.0) && (g->records[triangle].material & KILN_RECORD_DOUBLE_SIDED) == 0))
        return INFINITY;
    const double v = dvec3_dot(normal, dvec3_cross(dvec3_sub(b, a), to)) / square,
                 u = dvec3_dot(normal, dvec3_cross(to, dvec3_sub(c, a))) / square;
    if (u >= 0.0 && v >= 0.0 && u + v <= 1.0)
        return fabs(height) / sqrt(square);
    return sqrt(fmin(square_to_edge(place, a, b), fmin(square_to_edge(place, b, c), square_to_edge(place, c, a))));
}

/* The root of the area that a texel has on a triangle, m; 0 if it has none in the lightmap. */
static double texel_side(const struct kiln_geometry *g, uint64_t triangle)
{
    const float *t = g->records[triangle].texel;
    const double texels = 0.5 * fabs((double)t[2] * (double)t[5] - (double)t[3] * (double)t[4]);
    return texels > 0.0 ? sqrt(kiln_geometry_triangle_area(g, triangle) / texels) : 0.0;
}

/* An object's bounds, grown by its largest texel. */
struct bounds {
    struct kiln_dvec3 low, high;
};

static uint64_t triangle_of(const struct kiln_object_range *range, uint64_t i)
{
    return i < range->opaque_count ? range->opaque_first + i : range->alpha_first + (i - range->opaque_count);
}

static struct bounds bounds_of(const struct kiln_geometry *g, const struct kiln_object_range *range)
{
    struct kiln_dvec3 low = dvec3(INFINITY, INFINITY, INFINITY), high = dvec3(-INFINITY, -INFINITY, -INFINITY);
    double side = 0.0;
    for (uint64_t i = 0; i < range->opaque_count + range->alpha_count; i++) {
        const uint64_t triangle = triangle_of(range, i);
        struct kiln_vec3 corner[3];
        kiln_geometry_corners(g, triangle, corner);
        side = fmax(side, texel_side(g, triangle));
        for (int c = 0; c < 3; c++) {
            const struct kiln_dvec3 p = dvec3_of(corner[c]);
            low = dvec3(fmin(low.x, p.x), fmin(low.y, p.y), fmin(low.z, p.z));
            high = dvec3(fmax(high.x, p.x), fmax(high.y, p.y), fmax(high.z, p.z));
        }
    }
    const struct kiln_dvec3 margin = dvec3(side, side, side);
    return (struct bounds){dvec3_sub(low, margin), dvec3_add(high, margin)};
}

static bool is_inside(const struct bounds *b, struct kiln_dvec3 p)
{
    return p.x >= b->low.x && p.x <= b->high.x && p.y >= b->low.y && p.y <= b->high.y && p.z >= b->low.z &&
           p.z <= b->high.z;
}

/* Whether the light is nearer to the object than a texel is wide; keeps the worst case. */
static bool is_near(const struct kiln_geometry *g, uint32_t object, struct kiln_dvec3 light,
                    struct kiln_near_light *worst)
{
    const struct kiln_object_range *range = &g->ranges[object];
    bool near = false;
    for (uint64_t i = 0; i < range->opaque_count + range->alpha_count; i++) {
        const uint64_t triangle = triangle_of(range, i);
        const double side = texel_side(g, triangle), distance = distance_to(g, triangle, light);
        if (!(distance < side))
            continue;
        near = true;
        if (worst->side > 0.0 && distance * worst->side >= worst->distance * side)
            continue;
        worst->object = object;
        worst->distance = distance;
        worst->side = side;
    }
    return near;
}

struct kiln_near_light kiln_near_lights(const struct kiln_lights *lights)
{
    const struct kiln_geometry *g = lights->geometry;
    struct kiln_near_light worst = {0};
    for (size_t o = 0; lights->point_count > 0 && o < lights->scene->object_count; o++) {
        const struct bounds bounds = bounds_of(g, &g->ranges[o]);
        bool near = false;
        for (size_t i = 0; i < lights->point_count; i++)
            if (is_inside(&bounds, lights->points[i].position))
                near = is_near(g, (uint32_t)o, lights->points[i].position, &worst) || near;
        worst.objects += near;
    }
    return worst;
}
