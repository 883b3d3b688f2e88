#include "coordinator/layout/density.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>

#include "worker/base/memory.h"

/* largest fraction of all texels for one object, chosen so that it stays below a quarter: sides are rounded up, and
 * packing is not predictable to the texel */
static const double largest_fraction = 0.24;
/* largest fraction of the target for all objects of least size together */
static const double small_fraction = 0.125;
/* LEAST_NEXT: least texels across the largest object of another size; VAST_MOST: most vast objects; ANOTHER_SIZE:
 * ratio of areas from which on objects have different sizes */
enum { LEAST_SIDE = 8, ROUNDS_MAX = 200, LEAST_NEXT = 4, VAST_MOST = 64, ANOTHER_SIZE = 16 };

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

/* Data for choosing densities. */
struct chooser {
    const struct kiln_density_demand *demands;
    bool *vast; /* per object */
    size_t count, largest;
    double most, least; /* most texels of an object; least texels along a longer side */
};

static bool is_larger(const struct kiln_density_demand *a, const struct kiln_density_demand *b)
{
    return a->factor != b->factor ? a->factor > b->factor : a->area > b->area;
}

/* Returns the largest object that is not vast and has at most `area` m2; SIZE_MAX: none. Objects whose density a factor
 * lowers come last, since they are hardly looked at. */
static size_t find_largest(const struct chooser *c, double area)
{
    size_t largest = SIZE_MAX;
    for (size_t i = 0; i < c->count; i++)
        if (is_wanted(&c->demands[i]) && !c->vast[i] && c->demands[i].area <= area &&
            (largest == SIZE_MAX || is_larger(&c->demands[i], &c->demands[largest])))
            largest = i;
    return largest;
}

/* The density of an object when the common density is `common` and no object has more than c->most texels, without
 * regard to how small it is. */
static double bounded(const struct chooser *c, size_t index, double common)
{
    const struct kiln_density_demand *demand = &c->demands[index];
    const double wanted = common * demand->factor;
    if (!(demand->texels * wanted * wanted > c->most))
        return wanted;
    const double limited = sqrt(c->most / demand->texels);
    return c->vast[index] ? limited : fmax(limited, wanted / KILN_DENSITY_SPREAD);
}

/* Returns the density as bounded(), but so that the longer side has at least c->least texels, as far as the largest
 * object's density allows. */
static double density_of(const struct chooser *c, size_t index, double common)
{
    const double density = bounded(c, index, common), small = c->least / c->demands[index].longer;
    if (index == c->largest || c->largest == SIZE_MAX)
        return fmax(density, small);
    const struct kiln_density_demand *largest = &c->demands[c->largest];
    const double most = KILN_DENSITY_SPREAD * fmax(bounded(c, c->largest, common), c->least / largest->longer) *
                        largest->mean / c->demands[index].mean;
    return fmin(fmax(density, small), most);
}

static double total_texels(const struct chooser *c, double common)
{
    double sum = 0.0;
    for (size_t i = 0; i < c->count; i++) {
        if (!is_wanted(&c->demands[i]))
            continue;
        const double density = density_of(c, i, common);
        sum += c->demands[i].texels * density * density;
    }
    return sum;
}

/* Finds the common density at which the objects together have `target` texels, by bisection: the sum grows with the
 * density. */
static double solve_common(const struct chooser *c, double target)
{
    double low = INFINITY, high = 0.0;
    for (size_t i = 0; i < c->count; i++) {
        if (!is_wanted(&c->demands[i]))
            continue;
        /* at this density and above the object has its largest number of texels */
        const double full = sqrt(c->most / c->demands[i].texels) / c->demands[i].factor;
        high = fmax(high, full);
        low = fmin(low, full);
    }
    low *= 1e-3 / sqrt((double)c->count);
    for (int i = 0; i < 64 && high > low * (1.0 + 1e-9); i++) {
        const double middle = sqrt(low * high);
        if (total_texels(c, middle) < target)
            low = middle;
        else
            high = middle;
    }
    return high;
}

/* Sets the most texels of an object as a fraction of the actual sum, which differs from the target, since densities are
 * rounded. It is the largest number that is `fraction` of the sum it leads to, found by iteration from above. */
static void settle_most(struct chooser *c, double fraction, double common)
{
    c->most = INFINITY;
    for (int i = 0; i < ROUNDS_MAX; i++) {
        const double next = fraction * total_texels(c, common);
        const bool settled = next >= c->most * (1.0 - 1e-9);
        c->most = next;
        if (settled)
            break;
    }
}

/* Whether the largest object is vast: it is limited, and if others depended on it, the largest object of another size
 * would be too coarse. */
static bool is_vast(const struct chooser *c, double common)
{
    if (c->largest == SIZE_MAX)
        return false;
    const struct kiln_density_demand *largest = &c->demands[c->largest];
    const size_t next = find_largest(c, largest->area / ANOTHER_SIZE);
    return next != SIZE_MAX && bounded(c, c->largest, common) < common * largest->factor &&
           density_of(c, next, common) * c->demands[next].longer < LEAST_NEXT;
}

/* Chooses the common density, and which objects are vast. */
static double choose_common(struct chooser *c, double fraction, double target)
{
    double common = 1.0;
    for (int round = 0; round < VAST_MOST; round++) {
        c->largest = find_largest(c, INFINITY);
        c->most = fraction * target;
        common = tidy(solve_common(c, target));
        settle_most(c, fraction, common);
        if (!is_vast(c, common))
            break;
        c->vast[c->largest] = true;
    }
    return common;
}

int kiln_density_choose(struct kiln_density *density, const struct kiln_density_demand *demands, size_t count,
                        double target, struct kiln_error *error)
{
    const size_t wanted = count_wanted(demands, count);
    struct chooser c = {.demands = demands, .count = count, .largest = SIZE_MAX, .most = target, .least = 1.0};
    *density =
        (struct kiln_density){.texels_per_metre = 1.0, .most_texels = target, .least_side = 1, .largest = SIZE_MAX};
    int status;
    KILN_TRY(kiln_allocate(&density->of, count, sizeof *density->of, "densities", error));
    KILN_TRY(kiln_allocate(&c.vast, count, sizeof *c.vast, "densities", error));
    for (size_t i = 0; i < count; i++)
        c.vast[i] = demands[i].ground;
    if (wanted > 0) {
        c.least = fmin(LEAST_SIDE, floor(sqrt(small_fraction * target / (double)wanted)));
        density->texels_per_metre = choose_common(&c, fmax(largest_fraction, 1.0 / (double)wanted), target);
        density->least_side = (uint32_t)fmax(c.least, 1.0);
        density->most_texels = c.most;
        density->largest = c.largest;
    }
    for (size_t i = 0; i < count; i++)
        density->of[i] =
            is_wanted(&demands[i]) ? density_of(&c, i, density->texels_per_metre) : density->texels_per_metre;
end:
    kiln_free(&c.vast);
    return status;
}
