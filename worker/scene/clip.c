#include "worker/scene/clip.h"

/* Clips to one half-plane: keeps sign * (coordinate - bound) >= 0. `axis` 0 is x. Axis and sign are constants in the
 * callers. */
static inline uint32_t clip_half_plane(const struct kiln_clip_corner *in, uint32_t count, int axis, double bound,
                                       double sign, struct kiln_clip_corner *out)
{
    uint32_t kept = 0;
    const struct kiln_clip_corner *a = &in[count - 1];
    double da = sign * ((axis == 0 ? a->x : a->y) - bound);
    for (uint32_t i = 0; i < count; i++) {
        const struct kiln_clip_corner *b = &in[i];
        const double db = sign * ((axis == 0 ? b->x : b->y) - bound);
        if ((da > 0.0 && db < 0.0) || (da < 0.0 && db > 0.0)) {
            const double t = da / (da - db);
            struct kiln_clip_corner *c = &out[kept++];
            /* exactly on the line, so that the neighbouring rectangle's polygon begins where this one ends */
            c->x = axis == 0 ? bound : a->x + t * (b->x - a->x);
            c->y = axis == 0 ? a->y + t * (b->y - a->y) : bound;
            c->b1 = a->b1 + t * (b->b1 - a->b1);
            c->b2 = a->b2 + t * (b->b2 - a->b2);
        }
        if (db >= 0.0)
            out[kept++] = *b;
        a = b;
        da = db;
    }
    return kept;
}

/* A triangle without area in the lightmap belongs to the rectangle entirely, or not at all. */
static uint32_t place_collapsed(const double corner[3][2], double x0, double y0, double x1, double y1,
                                struct kiln_clip_corner *polygon)
{
    static const double below_one = 0x1.fffffffffffffp-1;
    const double x = (corner[0][0] + corner[1][0] + corner[2][0]) / 3.0,
                 y = (corner[0][1] + corner[1][1] + corner[2][1]) / 3.0;
    const double at_x = fmin(fmax(x, 0.0), below_one), at_y = fmin(fmax(y, 0.0), below_one);
    if (at_x < x0 || at_x >= x1 || at_y < y0 || at_y >= y1)
        return 0;
    for (int c = 0; c < 3; c++)
        polygon[c] = (struct kiln_clip_corner){corner[c][0], corner[c][1], c == 1 ? 1.0 : 0.0, c == 2 ? 1.0 : 0.0};
    return 3;
}

/* Clips to [low, high] along an axis, where a corner of the triangle lies outside. */
static inline uint32_t cut_axis(const double corner[3][2], int axis, double low, double high,
                                const struct kiln_clip_corner *in, uint32_t count,
                                struct kiln_clip_corner polygon[KILN_CLIP_CORNERS])
{
    struct kiln_clip_corner other[KILN_CLIP_CORNERS];
    bool below = false, above = false;
    for (int c = 0; c < 3; c++) {
        below |= corner[c][axis] < low;
        above |= corner[c][axis] > high;
    }
    if (count > 0 && below && above) {
        count = clip_half_plane(in, count, axis, low, 1.0, other);
        return count > 0 ? clip_half_plane(other, count, axis, high, -1.0, polygon) : 0;
    }
    if (count > 0 && below)
        return clip_half_plane(in, count, axis, low, 1.0, polygon);
    if (count > 0 && above)
        return clip_half_plane(in, count, axis, high, -1.0, polygon);
    for (uint32_t i = 0; i < count; i++)
        polygon[i] = in[i];
    return count;
}

uint32_t kiln_clip_column(const double corner[3][2], double x0, double x1,
                          struct kiln_clip_corner polygon[KILN_CLIP_CORNERS])
{
    const struct kiln_clip_corner whole[3] = {{corner[0][0], corner[0][1], 0.0, 0.0},
                                              {corner[1][0], corner[1][1], 1.0, 0.0},
                                              {corner[2][0], corner[2][1], 0.0, 1.0}};
    return cut_axis(corner, 0, x0, x1, whole, 3, polygon);
}

uint32_t kiln_clip_rows(const double corner[3][2], const struct kiln_clip_corner *column, uint32_t count, double y0,
                        double y1, struct kiln_clip_corner polygon[KILN_CLIP_CORNERS])
{
    return cut_axis(corner, 1, y0, y1, column, count, polygon);
}

uint32_t kiln_clip_triangle(const double corner[3][2], double x0, double y0, double x1, double y1,
                            struct kiln_clip_corner polygon[KILN_CLIP_CORNERS])
{
    struct kiln_clip_corner column[KILN_CLIP_CORNERS];
    if (!(fabs(kiln_clip_twice_area(corner)) > 0.0))
        return place_collapsed(corner, x0, y0, x1, y1, polygon);
    const uint32_t count = kiln_clip_column(corner, x0, x1, column);
    return kiln_clip_rows(corner, column, count, y0, y1, polygon);
}

/* Clips to the half-plane distance[i] >= 0, with the distance of each corner i. */
static uint32_t cut(struct kiln_clip_corner polygon[KILN_CLIP_CORNERS], uint32_t count,
                    const double distance[KILN_CLIP_CORNERS])
{
    struct kiln_clip_corner out[2 * KILN_CLIP_CORNERS];
    uint32_t kept = 0;
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t before = i > 0 ? i - 1 : count - 1;
        const struct kiln_clip_corner *a = &polygon[before], *b = &polygon[i];
        const double da = distance[before], db = distance[i];
        if ((da > 0.0 && db < 0.0) || (da < 0.0 && db > 0.0)) {
            const double t = da / (da - db);
            out[kept++] = (struct kiln_clip_corner){a->x + t * (b->x - a->x), a->y + t * (b->y - a->y),
                                                    a->b1 + t * (b->b1 - a->b1), a->b2 + t * (b->b2 - a->b2)};
        }
        if (db >= 0.0)
            out[kept++] = *b;
    }
    if (kept > KILN_CLIP_CORNERS)
        return count;
    for (uint32_t i = 0; i < kept; i++)
        polygon[i] = out[i];
    return kept;
}

uint32_t kiln_clip_line(struct kiln_clip_corner polygon[KILN_CLIP_CORNERS], uint32_t count, const float line[3])
{
    double distance[KILN_CLIP_CORNERS];
    for (uint32_t i = 0; i < count; i++)
        distance[i] = (double)line[2] - (double)line[0] * polygon[i].x - (double)line[1] * polygon[i].y;
    return count < 3 ? 0 : cut(polygon, count, distance);
}

/* Clips to the half-space sign * (depth - bound) >= 0. */
static uint32_t cut_depth(struct kiln_clip_corner polygon[KILN_CLIP_CORNERS], uint32_t count, const double depth[3],
                          double bound, double sign)
{
    double distance[KILN_CLIP_CORNERS];
    for (uint32_t i = 0; i < count; i++)
        distance[i] = sign * (kiln_clip_depth(&polygon[i], depth) - bound);
    return count < 3 ? 0 : cut(polygon, count, distance);
}

uint32_t kiln_clip_depths(struct kiln_clip_corner polygon[KILN_CLIP_CORNERS], uint32_t count, const double depth[3])
{
    const double low = fmin(depth[0], fmin(depth[1], depth[2])), high = fmax(depth[0], fmax(depth[1], depth[2]));
    if (!(low < high))
        return low >= 0.0 && low < 1.0 ? count : 0;
    if (low < 0.0)
        count = cut_depth(polygon, count, depth, 0.0, 1.0);
    return high > 1.0 ? cut_depth(polygon, count, depth, 1.0, -1.0) : count;
}

/* Sums over the polygon's triangle fan: doubled areas, in the lightmap or in barycentrics, and centroids times these.
 */
static double fan_sum(const struct kiln_clip_corner *polygon, uint32_t count, bool weights,
                      struct kiln_clip_corner *sum)
{
    double twice = 0.0;
    const struct kiln_clip_corner *o = polygon;
    *sum = (struct kiln_clip_corner){0.0, 0.0, 0.0, 0.0};
    for (uint32_t i = 2; i < count; i++) {
        const struct kiln_clip_corner *a = &polygon[i - 1], *b = &polygon[i];
        const double w = weights ? (a->b1 - o->b1) * (b->b2 - o->b2) - (b->b1 - o->b1) * (a->b2 - o->b2)
                                 : (a->x - o->x) * (b->y - o->y) - (b->x - o->x) * (a->y - o->y);
        twice += w;
        sum->x += w * (a->x + b->x - 2.0 * o->x);
        sum->y += w * (a->y + b->y - 2.0 * o->y);
        sum->b1 += w * (a->b1 + b->b1 - 2.0 * o->b1);
        sum->b2 += w * (a->b2 + b->b2 - 2.0 * o->b2);
    }
    return twice;
}

static void finish_centroid(const struct kiln_clip_corner *o, const struct kiln_clip_corner *sum, double twice,
                            struct kiln_clip_corner *centroid)
{
    const double scale = 1.0 / (3.0 * twice);
    *centroid = (struct kiln_clip_corner){o->x + sum->x * scale, o->y + sum->y * scale, o->b1 + sum->b1 * scale,
                                          o->b2 + sum->b2 * scale};
}

double kiln_clip_area(const struct kiln_clip_corner *polygon, uint32_t count, struct kiln_clip_corner *centroid)
{
    struct kiln_clip_corner sum;
    const double twice = fan_sum(polygon, count, false, &sum);
    if (!(fabs(twice) > 0.0))
        return 0.0;
    finish_centroid(polygon, &sum, twice, centroid);
    return 0.5 * fabs(twice);
}

double kiln_clip_fraction(const struct kiln_clip_corner *polygon, uint32_t count, struct kiln_clip_corner *centroid)
{
    struct kiln_clip_corner sum;
    /* in barycentric weights the whole triangle has the area 1/2 */
    const double fraction = fan_sum(polygon, count, true, &sum);
    if (!(fraction > 0.0))
        return 0.0;
    finish_centroid(polygon, &sum, fraction, centroid);
    return fraction;
}
