/* View factors from a small surface element to a parallelogram: see worker/light/view_factor.h. */
#ifndef KILN_SHADERS_SHARED_VIEW_FACTOR_H
#define KILN_SHADERS_SHARED_VIEW_FACTOR_H

#include "shaders/shared/real.h"

#define KILN_CLIPPED_MOST 6u /* maximum number of corners of a parallelogram clipped twice */

struct kiln_clipped {
    kiln_real3 corner[KILN_CLIPPED_MOST];
    KILN_U32 count;
};

/* Returns the part of the polygon above the plane through the origin with normal n. */
KILN_FUNCTION KILN_STRUCT kiln_clipped kiln_clip(KILN_STRUCT kiln_clipped from, kiln_real3 n)
{
    KILN_STRUCT kiln_clipped to;
    to.count = 0u;
    for (KILN_U32 i = 0u; i < from.count; i++) {
        const kiln_real3 a = from.corner[i], b = from.corner[(i + 1u) % from.count];
        const kiln_real height_a = real3_dot(a, n), height_b = real3_dot(b, n);
        if (height_a > 0)
            to.corner[to.count++] = a;
        if ((height_a > 0) != (height_b > 0))
            to.corner[to.count++] = real3_add(a, real3_scale(real3_sub(b, a), height_a / (height_a - height_b)));
    }
    return to;
}

/* Returns the view factor of the parallelogram with this centre and these edges, clipped to its part above the horizons
 * of n and `about`. */
KILN_FUNCTION kiln_real kiln_view_factor(kiln_real3 centre, kiln_real3 edge_s, kiln_real3 edge_t, kiln_real3 n,
                                         kiln_real3 about)
{
    const kiln_real half_edge = KILN_RATIO(1, 2);
    const kiln_real3 s = real3_scale(edge_s, half_edge), t = real3_scale(edge_t, half_edge);
    KILN_STRUCT kiln_clipped seen;
    seen.corner[0] = real3_sub(real3_sub(centre, s), t);
    seen.corner[1] = real3_sub(real3_add(centre, s), t);
    seen.corner[2] = real3_add(real3_add(centre, s), t);
    seen.corner[3] = real3_add(real3_sub(centre, s), t);
    seen.count = 4u;
    seen = kiln_clip(kiln_clip(seen, n), about);
    kiln_real sum = kiln_real_of(0);
    for (KILN_U32 i = 0u; i < seen.count; i++) {
        const kiln_real3 a = seen.corner[i], b = seen.corner[(i + 1u) % seen.count], g = real3_cross(a, b);
        const kiln_real across = real3_length(g);
        if (across > 0)
            sum += real_atan2(across, real3_dot(a, b)) * real3_dot(g, about) / across;
    }
    return real_abs(sum) / (2 * KILN_REAL_PI);
}

#endif
