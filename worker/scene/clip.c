#include "worker/scene/clip.h"

#include <math.h>

/* One cut: keeps sign * (coordinate - bound) >= 0. `axis` 0 is x. */
static uint32_t cut(const struct kiln_clip_corner *in, uint32_t count, int axis, double bound, double sign,
                    struct kiln_clip_corner *out)
{
    uint32_t kept = 0;
    for (uint32_t i = 0; i < count; i++) {
        const struct kiln_clip_corner *a = &in[i], *b = &in[i + 1 == count ? 0 : i + 1];
        const double da = sign * ((axis == 0 ? a->x : a->y) - bound), db = sign * ((axis == 0 ? b->x : b->y) - bound);
        if (da >= 0.0)
            out[kept++] = *a;
        if ((da > 0.0 && db < 0.0) || (da < 0.0 && db > 0.0)) {
            const double t = da / (da - db);
            struct kiln_clip_corner c = {a->x + t * (b->x - a->x), a->y + t * (b->y - a->y), a->b1 + t * (b->b1 - a->b1),
                                         a->b2 + t * (b->b2 - a->b2)};
            if (axis == 0)
                c.x = bound; /* exactly on the line, so that the neighbour's part begins where this one ends */
            else
                c.y = bound;
            out[kept++] = c;
        }
    }
    return kept;
}

uint32_t kiln_clip_triangle(const double corner[3][2], double x0, double y0, double x1, double y1,
                            struct kiln_clip_corner polygon[KILN_CLIP_CORNERS])
{
    struct kiln_clip_corner other[KILN_CLIP_CORNERS];
    polygon[0] = (struct kiln_clip_corner){corner[0][0], corner[0][1], 0.0, 0.0};
    polygon[1] = (struct kiln_clip_corner){corner[1][0], corner[1][1], 1.0, 0.0};
    polygon[2] = (struct kiln_clip_corner){corner[2][0], corner[2][1], 0.0, 1.0};
    uint32_t count = cut(polygon, 3, 0, x0, 1.0, other);
    count = cut(other, count, 0, x1, -1.0, polygon);
    count = cut(polygon, count, 1, y0, 1.0, other);
    return cut(other, count, 1, y1, -1.0, polygon);
}

double kiln_clip_area(const struct kiln_clip_corner *polygon, uint32_t count, struct kiln_clip_corner *centroid)
{
    double twice = 0.0;
    struct kiln_clip_corner sum = {0.0, 0.0, 0.0, 0.0};
    const struct kiln_clip_corner *o = polygon;
    for (uint32_t i = 2; i < count; i++) {
        const struct kiln_clip_corner *a = &polygon[i - 1], *b = &polygon[i];
        const double w = (a->x - o->x) * (b->y - o->y) - (b->x - o->x) * (a->y - o->y);
        twice += w;
        sum.x += w * (a->x + b->x - 2.0 * o->x);
        sum.y += w * (a->y + b->y - 2.0 * o->y);
        sum.b1 += w * (a->b1 + b->b1 - 2.0 * o->b1);
        sum.b2 += w * (a->b2 + b->b2 - 2.0 * o->b2);
    }
    if (twice == 0.0)
        return 0.0;
    const double scale = 1.0 / (3.0 * twice);
    *centroid = (struct kiln_clip_corner){o->x + sum.x * scale, o->y + sum.y * scale, o->b1 + sum.b1 * scale, o->b2 + sum.b2 * scale};
    return 0.5 * fabs(twice);
}
