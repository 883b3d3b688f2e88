#include "coordinator/layout/density.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>

#include "worker/base/memory.h"

/* the fraction aimed at to stay below a quarter: sides are rounded up, and packing cannot be predicted to the texel */
static const double largest_fraction = 0.24;
/* the fraction of the target that all objects of least size together take at most */
static const double small_fraction = 0.125;
enum { LEAST_SIDE = 8, ROUNDS_MAX = 200 };

/* Rounds to the nearest, by ratio, of ten round numbers per decade. */
static double tidy(double value)
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

/* The density of an object when the common density is `common`, no object has more than `most` texels, and no longer
 * side is shorter than `least`. The least side takes precedence: it is a few dozen texels. */
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

/* Finds the common density at which the objects together have `target` texels, each at most `most`, by bisection: the
 * sum grows with the density. */
static double solve_common(const struct kiln_density_demand *demands, size_t count, double target, double most,
                           double least)
{
    double low = INFINITY, high = 0.0;
    for (size_t i = 0; i < count; i++) {
        if (!is_wanted(&demands[i]))
            continue;
        /* from this density on the object has the most it may have */
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

/* The most texels an object may have, as a fraction of the real sum: a rounded density makes more or fewer texels than
 * the target. Finds the largest number of texels that is `fraction` of the sum it leads to, by iteration from above. */
static double settle_most(const struct kiln_density_demand *demands, size_t count, double fraction, double common,
                          double least)
{
    double most = INFINITY;
    for (int i = 0; i < ROUNDS_MAX; i++) {
        const double next = fraction * total_texels(demands, count, common, most, least);
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
        const double fraction = fmax(largest_fraction, 1.0 / (double)wanted);
        const double least = fmin(LEAST_SIDE, floor(sqrt(small_fraction * target / (double)wanted)));
        const double common = tidy(solve_common(demands, count, target, fraction * target, least));
        density->texels_per_metre = common;
        density->least_side = (uint32_t)fmax(least, 1.0);
        density->most_texels = settle_most(demands, count, fraction, common, least);
    }
    for (size_t i = 0; i < count; i++)
        density->of[i] = is_wanted(&demands[i]) ? density_of(&demands[i], density->texels_per_metre,
                                                             density->most_texels, density->least_side)
                                                : density->texels_per_metre;
    return KILN_OK;
}
