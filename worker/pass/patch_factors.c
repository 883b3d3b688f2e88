#include "worker/pass/patch_factors.h"

#include <math.h>

#include "worker/light/view_factor.h"

/* Mean over a parallelogram of n.d / |d|^4, divided by |d|^-4 at its centre, to second order in its size; the other
 * cosine is constant over it. */
static double mean_height(const struct kiln_patch *from, struct kiln_dvec3 n, struct kiln_dvec3 d, double square)
{
    const struct kiln_dvec3 edges[2] = {dvec3_of(from->edge_s), dvec3_of(from->edge_t)};
    const double height = dvec3_dot(n, d);
    double sum = height;
    for (int i = 0; i < 2; i++) {
        const double along = dvec3_dot(d, edges[i]) / square;
        sum += height * (along * along - dvec3_dot(edges[i], edges[i]) / (6.0 * square)) -
               dvec3_dot(n, edges[i]) * along / 3.0;
    }
    return fmax(0.0, sum);
}

/* Whether a patch at d must be integrated as a polygon: it is near, or crosses the horizon. `square`: squared distance.
 */
static bool is_near(const struct kiln_patch_receiver *point, const struct kiln_patch *from, double cosine,
                    double square)
{
    const double reach =
        fabs(dvec3_dot(point->n, dvec3_of(from->edge_s))) + fabs(dvec3_dot(point->n, dvec3_of(from->edge_t)));
    return square < KILN_PATCHES_NEAR * KILN_PATCHES_NEAR * (double)from->area || cosine < 0.5 * reach;
}

struct kiln_patch_factors kiln_patch_factors(const struct kiln_patch_receiver *point, const struct kiln_patch *from,
                                             struct kiln_dvec3 d, double square, double cosine, double other)
{
    const double far = (double)from->area * other / (KILN_PI * square * square);
    struct kiln_patch_factors f;
    if (is_near(point, from, cosine, square)) {
        const struct kiln_parallelogram near = {d, dvec3_of(from->edge_s), dvec3_of(from->edge_t)};
        f.factor = kiln_view_factor_near(&near, point->n, point->n);
        f.shading = point->smooth ? kiln_view_factor_near(&near, point->n, point->s) : f.factor;
    } else {
        f.factor = far * mean_height(from, point->n, d, square);
        f.shading = point->smooth ? far * mean_height(from, point->s, d, square) : f.factor;
    }
    return f;
}
