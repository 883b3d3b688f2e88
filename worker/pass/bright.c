#include "worker/pass/bright.h"

#include <math.h>

/* Extent of a flat cluster along a direction with this cosine to its normal; the whole extent if it is not flat. */
static double reach(const struct kiln_bright_cluster *c, double cosine)
{
    return (double)c->radius * (c->is_flat ? sqrt(fmax(0.0, 1.0 - cosine * cosine)) : 1.0);
}

/* Upper bound of the cosine at cluster `c` to a cluster at distance `length`. `above`: height of that cluster over the
 * plane of `c`; `beyond`: its extent along the plane's normal. */
static double cosine_bound(const struct kiln_bright_cluster *c, double above, double beyond, double length)
{
    return c->is_flat ? fmin(1.0, fmax(0.0, above + beyond - 1e-4 * length) / length) : 1.0;
}

/* Approximate irradiance, W/m2, that bright points of the second cluster cause at the first. */
static double bound_light(const struct kiln_bright_cluster *to, const struct kiln_bright_cluster *from)
{
    const struct kiln_dvec3 d = dvec3_sub(dvec3_of(from->centre), dvec3_of(to->centre));
    const struct kiln_dvec3 n = dvec3_of(to->normal), m = dvec3_of(from->normal);
    const double near = (double)to->radius * (double)to->radius + (double)from->radius * (double)from->radius,
                 square = fmax(dvec3_dot(d, d), near), length = sqrt(square), between = dvec3_dot(n, m);
    if (!(from->power > 0.0) || !(square > 0.0))
        return 0.0;
    return from->power * cosine_bound(to, dvec3_dot(n, d), reach(from, between), length) *
           cosine_bound(from, -dvec3_dot(m, d), reach(to, between), length) / (KILN_PI * square);
}

/* Share of rays that go to patches, if these cause an irradiance of `light` W/m2. */
static double share_of(const struct kiln_bright *bright, double light)
{
    const double share = light > 0.0 ? light / (light + bright->rest) : 0.0;
    return share < 1.0 / 16.0 ? 0.0 : share < 3.0 / 16.0 ? 0.125 : share < 3.0 / 8.0 ? 0.25 : 0.5;
}

void kiln_bright_begin(const struct kiln_bright *bright, uint32_t samples, struct kiln_bright_receiver *r)
{
    double sum = 0.0;
    for (uint32_t c = 0; c < bright->count && r->cluster != KILN_NO_CLUSTER; c++) {
        sum += bound_light(&bright->clusters[r->cluster], &bright->clusters[c]);
        r->sums[c] = sum;
    }
    const uint32_t to_patches = (uint32_t)(share_of(bright, sum) * samples);
    r->by_cosine = samples - to_patches;
    r->share = (double)to_patches / samples;
}
