#include "worker/light/view_factor.h"

#include <math.h>
#include <stdint.h>

enum { CORNERS = 6 }; /* of a parallelogram clipped twice */

struct polygon {
    struct kiln_dvec3 corner[CORNERS];
    uint32_t count;
};

/* What of the polygon lies above the plane through the origin with normal n. */
static struct polygon clip(const struct polygon *from, struct kiln_dvec3 n)
{
    struct polygon to = {.count = 0};
    for (uint32_t i = 0; i < from->count; i++) {
        const struct kiln_dvec3 a = from->corner[i], b = from->corner[(i + 1) % from->count];
        const double height_a = dvec3_dot(a, n), height_b = dvec3_dot(b, n);
        if (height_a > 0.0)
            to.corner[to.count++] = a;
        if ((height_a > 0.0) != (height_b > 0.0))
            to.corner[to.count++] = dvec3_add(a, dvec3_scale(dvec3_sub(b, a), height_a / (height_a - height_b)));
    }
    return to;
}

double kiln_view_factor_near(const struct kiln_parallelogram *p, struct kiln_dvec3 n, struct kiln_dvec3 about)
{
    const struct kiln_dvec3 s = dvec3_scale(p->edge_s, 0.5), t = dvec3_scale(p->edge_t, 0.5);
    const struct polygon whole = {{dvec3_sub(dvec3_sub(p->centre, s), t), dvec3_sub(dvec3_add(p->centre, s), t),
                                   dvec3_add(dvec3_add(p->centre, s), t), dvec3_add(dvec3_sub(p->centre, s), t)},
                                  4};
    const struct polygon above = clip(&whole, n), seen = clip(&above, about);
    double sum = 0.0;
    for (uint32_t i = 0; i < seen.count; i++) {
        const struct kiln_dvec3 a = seen.corner[i], b = seen.corner[(i + 1) % seen.count], g = dvec3_cross(a, b);
        const double length = dvec3_length(g);
        if (length > 0.0)
            sum += atan2(length, dvec3_dot(a, b)) * dvec3_dot(g, about) / length;
    }
    return fabs(sum) / (2.0 * KILN_PI);
}
