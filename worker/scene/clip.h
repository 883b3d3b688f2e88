/* Clips triangles to axis-aligned rectangles of their lightmap. These functions define what "a triangle covers a texel"
 * means everywhere in the program.
 *
 * The method is polygon clipping of Sutherland and Hodgman ("Reentrant Polygon Clipping", 1974) in double. Barycentric
 * weights are interpolated along with the coordinates, so that the corners of a very thin triangle stay on it.
 * Coordinates should be relative to the texel (kiln_clip_local), which keeps rounding errors small. Pure functions. */
#ifndef KILN_WORKER_SCENE_CLIP_H
#define KILN_WORKER_SCENE_CLIP_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

/* Corners of a clipped polygon, at most. A triangle clipped by a rectangle has at most 7. If rounding makes the outline
 * of a thin triangle non-convex, each of the four cuts can add half as many corners as there were: 3, 4, 6, 9, 13. Each
 * of four more lines (shaders/shared/divided.h) adds one. */
enum { KILN_CLIP_CORNERS = 17 };

/* A covered area smaller than this is rounding and does not count. In texels or, where the triangle's own area is below
 * 1 texel, relative to that area. Corners at 2^14 texels are good to 2e-12. */
#define KILN_CLIP_SMALLEST 1e-11

struct kiln_clip_corner {
    double x, y;   /* position in the lightmap, texels */
    double b1, b2; /* barycentric weights of the triangle's corners 1 and 2 */
};

/* Clips a triangle, given in texel-local coordinates (kiln_clip_local), to the rectangle [x0, x1] x [y0, y1] inside the
 * square 0..1. Returns the number of corners of `polygon`; fewer than 3 mean that nothing is left. The winding is the
 * triangle's. A collapsed triangle, one without area in the lightmap, is not clipped, so that its surface is not lost:
 * it belongs wholly to the rectangle that holds its centroid (lower sides included; a centroid outside the square is
 * first moved into it). */
uint32_t kiln_clip_triangle(const double corner[3][2], double x0, double y0, double x1, double y1,
                            struct kiln_clip_corner polygon[KILN_CLIP_CORNERS]);

/* kiln_clip_triangle in two steps, for rectangles stacked in a column; the triangle must have area in the lightmap.
 * First its part in x0..x1 is found, with corners `column`, `count` of them; then the part of that in y0..y1. */
uint32_t kiln_clip_column(const double corner[3][2], double x0, double x1,
                          struct kiln_clip_corner polygon[KILN_CLIP_CORNERS]);
uint32_t kiln_clip_rows(const double corner[3][2], const struct kiln_clip_corner *column, uint32_t count, double y0,
                        double y1, struct kiln_clip_corner polygon[KILN_CLIP_CORNERS]);

/* Cuts a convex polygon along a line: keeps what lies at line[0] x + line[1] y <= line[2]. Returns the new number of
 * corners; fewer than 3 mean that nothing is left. If the polygon has no room for the new corners, it is not cut. */
uint32_t kiln_clip_line(struct kiln_clip_corner polygon[KILN_CLIP_CORNERS], uint32_t count, const float line[3]);

/* Cuts a convex polygon of a triangle to depths 0..1; `depth`: at the triangle's corners, linear between them. A
 * triangle of one depth lies there wholly, at 0 <= depth < 1, or not at all. Returns the new number of corners, as
 * kiln_clip_line does. */
uint32_t kiln_clip_depths(struct kiln_clip_corner polygon[KILN_CLIP_CORNERS], uint32_t count, const double depth[3]);

/* Area (>= 0, in the lightmap) and centroid of a convex polygon. `centroid` is left as it is when the area is 0. */
double kiln_clip_area(const struct kiln_clip_corner *polygon, uint32_t count, struct kiln_clip_corner *centroid);

/* Area of a convex polygon as a fraction, 0..1, of its triangle's area, computed from the barycentric weights; and the
 * polygon's centroid. `centroid` is left as it is when the fraction is 0. */
double kiln_clip_fraction(const struct kiln_clip_corner *polygon, uint32_t count, struct kiln_clip_corner *centroid);

/* Moves the triangle's corners so that texel (x, y) becomes the square 0..1 x 0..1. All code that clips to a texel
 * starts from these coordinates, so that all find the same polygons to the last bit. */
static inline void kiln_clip_local(const double corner[3][2], double x, double y, double local[3][2])
{
    for (int c = 0; c < 3; c++) {
        local[c][0] = corner[c][0] - x;
        local[c][1] = corner[c][1] - y;
    }
}

/* Barycentric weights of corners 1 and 2 as linear functions of the position: b1 = b1[0] + b1[1] x + b1[2] y, and so
 * b2. The triangle must have area. */
struct kiln_clip_weights {
    double b1[3], b2[3];
};
static inline struct kiln_clip_weights kiln_clip_weights(const double c[3][2])
{
    const double ax = c[1][0] - c[0][0], ay = c[1][1] - c[0][1], bx = c[2][0] - c[0][0], by = c[2][1] - c[0][1];
    const double inverse = 1.0 / (ax * by - bx * ay);
    struct kiln_clip_weights w = {{0.0, by * inverse, -bx * inverse}, {0.0, -ay * inverse, ax * inverse}};
    w.b1[0] = -(w.b1[1] * c[0][0] + w.b1[2] * c[0][1]);
    w.b2[0] = -(w.b2[1] * c[0][0] + w.b2[2] * c[0][1]);
    return w;
}

/* Depth at a corner of a clipped polygon. */
static inline double kiln_clip_depth(const struct kiln_clip_corner *corner, const double depth[3])
{
    return depth[0] + corner->b1 * (depth[1] - depth[0]) + corner->b2 * (depth[2] - depth[0]);
}

/* Twice the signed area of a triangle in the lightmap. */
static inline double kiln_clip_twice_area(const double c[3][2])
{
    return (c[1][0] - c[0][0]) * (c[2][1] - c[0][1]) - (c[2][0] - c[0][0]) * (c[1][1] - c[0][1]);
}

/* The smallest fraction of a triangle with this area (texels) that counts as covering a texel. */
static inline double kiln_clip_smallest(double triangle_area)
{
    return KILN_CLIP_SMALLEST / (triangle_area > 1.0 ? triangle_area : 1.0);
}

/* Whether the triangle holds the whole rectangle, edges included (INSIDE), surely misses its inside (OUTSIDE), or
 * neither can be said (PARTLY). Not for collapsed triangles. */
enum kiln_clip_class { KILN_CLIP_OUTSIDE = 0, KILN_CLIP_PARTLY = 1, KILN_CLIP_INSIDE = 2 };
static inline enum kiln_clip_class kiln_clip_classify(const double c[3][2], double x0, double y0, double x1, double y1)
{
    const double sign = kiln_clip_twice_area(c) < 0.0 ? -1.0 : 1.0;
    enum kiln_clip_class result = KILN_CLIP_INSIDE;
    for (int i = 0; i < 3; i++) {
        const double *a = c[i], *b = c[i == 2 ? 0 : i + 1];
        const double ex = sign * (b[0] - a[0]), ey = sign * (b[1] - a[1]);
        /* the edge function ex (y - ay) - ey (x - ax) is largest and smallest at opposite corners of the rectangle */
        const double most = ex * ((ex > 0.0 ? y1 : y0) - a[1]) - ey * ((ey > 0.0 ? x0 : x1) - a[0]);
        const double least = ex * ((ex > 0.0 ? y0 : y1) - a[1]) - ey * ((ey > 0.0 ? x1 : x0) - a[0]);
        if (most <= 0.0)
            return KILN_CLIP_OUTSIDE;
        if (least < 0.0)
            result = KILN_CLIP_PARTLY;
    }
    return result;
}

/* Range in x of the triangle's part between y0 and y1. It is widened by more than the rounding error, so it may be
 * slightly too large: clipping is exact. False when the triangle does not reach between them. */
static inline bool kiln_clip_reach(const double c[3][2], double y0, double y1, double *low, double *high)
{
    double x0 = INFINITY, x1 = -INFINITY;
    for (int i = 0; i < 3; i++) {
        const double *a = c[i], *b = c[i == 2 ? 0 : i + 1];
        if (a[1] >= y0 && a[1] <= y1) {
            x0 = a[0] < x0 ? a[0] : x0; /* fmin and fmax would become calls into the mathematics library here */
            x1 = a[0] > x1 ? a[0] : x1;
        }
        for (int side = 0; side < 2; side++) {
            const double y = side == 0 ? y0 : y1;
            if ((a[1] < y) != (b[1] < y)) {
                const double x = a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]);
                x0 = x < x0 ? x : x0;
                x1 = x > x1 ? x : x1;
            }
        }
    }
    *low = x0 - 1e-9 * (1.0 + fabs(x0));
    *high = x1 + 1e-9 * (1.0 + fabs(x1));
    return x0 <= x1;
}

#endif
