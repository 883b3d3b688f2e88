#include "coordinator/layout/density.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>

#include "worker/base/memory.h"

/* aimed at for a quarter: sides are rounded up, and packing is not foreseen to the texel */
static const double largest_share = 0.24;
static const double small_share = 0.125; /* of the target, which all objects of least size take together at most */
enum { LEAST_SIDE = 8, ROUNDS_MAX = 200 };

double kiln_density_tidy(double value)
{
    static const double steps[] = {1.0, 1.25, 1.6, 2.0, 2.5, 3.2, 4.0, 5.0, 6.4, 8.0, 10.0};
    const double decade = pow(10.0, floor(log10(value)));
    double best = decade;
    for (size_t i = 0; i < sizeof steps / sizeof *steps; i++)
        if (fabs(log(steps[i] * decade / value)) < fabs(log(best / value)))
            best = steps[i] * decade;
    return best;
}

static bool is_wanted(const struct kiln_density_demand *demand)
{
    return isfinite(demand->texels) && demand->texels > 0.0 && isfinite(demand->longer) && demand->longer > 0.0;
}

static size_t count_wanted(const struct kiln_density_demand *demands, size_t count)
{
    size_t wanted = 0;
    for (size_t i = 0; i < count; i++)
        wanted += is_wanted(&demands[i]);
    return wanted;
}

/* The density of an object when all have `common`, none more than `most` texels, none a side shorter than `least`. The
 * least size comes first: it is a few dozen texels. */
static double density_of(const struct kiln_density_demand *demand, double common, double most, double least)
{
    double density = common * demand->factor;
    if (demand->texels * density * density > most)
        density = sqrt(most / demand->texels);
    return fmax(density, least / demand->longer);
}

static double total_texels(const struct kiln_density_demand *demands, size_t count, double common, double most,
                           double least)
{
    double sum = 0.0;
    for (size_t i = 0; i < count; i++) {
        if (!is_wanted(&demands[i]))
            continue;
        const double density = density_of(&demands[i], common, most, least);
        sum += demands[i].texels * density * density;
    }
    return sum;
}

/* The common density at which the objects have `target` texels, each at most `most`: by bisection, for the sum grows
 * with it. */
static double solve_common(const struct kiln_density_demand *demands, size_t count, double target, double most,
                           double least)
{
    double low = INFINITY, high = 0.0;
    for (size_t i = 0; i < count; i++) {
        if (!is_wanted(&demands[i]))
            continue;
        /* from here on the object has its share */
        const double full = sqrt(most / demands[i].texels) / demands[i].factor;
        high = fmax(high, full);
        low = fmin(low, full);
    }
    low *= 1e-3 / sqrt((double)count);
    for (int i = 0; i < 64 && high > low * (1.0 + 1e-9); i++) {
        const double middle = sqrt(low * high);
        if (total_texels(demands, count, middle, most, least) < target)
            low = middle;
        else
            high = middle;
    }
    return high;
}

/* The share of what there really is, for a rounded density makes more or fewer texels than the target: the largest
 * number of texels that is `share` of the sum it leads to, from above. */
static double settle_most(const struct kiln_density_demand *demands, size_t count, double share, double common,
                          double least)
{
    double most = INFINITY;
    for (int i = 0; i < ROUNDS_MAX; i++) {
        const double next = share * total_texels(demands, count, common, most, least);
        const bool settled = next >= most * (1.0 - 1e-9);
        most = next;
        if (settled)
            break;
    }
    return most;
}

int kiln_density_choose(struct kiln_density *density, const struct kiln_density_demand *demands, size_t count,
                        double target, struct kiln_error *error)
{
    const size_t wanted = count_wanted(demands, count);
    *density = (struct kiln_density){.texels_per_metre = 1.0, .most_texels = target, .least_side = 1};
    const int status = kiln_allocate(&density->of, count, sizeof *density->of, "densities", error);
    if (status != KILN_OK)
        return status;
    if (wanted > 0) {
        const double share = fmax(largest_share, 1.0 / (double)wanted);
        const double least = fmin(LEAST_SIDE, floor(sqrt(small_share * target / (double)wanted)));
        const double common = kiln_density_tidy(solve_common(demands, count, target, share * target, least));
        density->texels_per_metre = common;
        density->least_side = (uint32_t)fmax(least, 1.0);
        density->most_texels = settle_most(demands, count, share, common, least);
    }
    for (size_t i = 0; i < count; i++)
        density->of[i] = is_wanted(&demands[i]) ? density_of(&demands[i], density->texels_per_metre,
                                                             density->most_texels, density->least_side)
                                                : density->texels_per_metre;
    return KILN_OK;
}
