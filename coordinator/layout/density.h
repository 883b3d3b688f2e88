/* Automatic density: how many texels a metre each object of a scene gets when the user gives no density.
 *
 * All objects get the same density, with two exceptions:
 * - An object that would take more than its allowed fraction of all texels (a ground plane around a house) gets that
 *   fraction, but no less than 1 / KILN_DENSITY_SPREAD of the common density. The fraction is a quarter; with fewer
 *   than four objects, which cannot all stay below a quarter, it is one over their number.
 * - An object whose lightmap would be less than a few texels across gets those few texels.
 *
 * No object gets more than KILN_DENSITY_SPREAD times the mean density of the largest one: with what rounding to whole
 * texels adds, less than twice. Objects that are vast do not count as the largest, and get their fraction alone: those
 * by which the largest object with a sixteenth of their area would be less than 4 texels across (a sky dome around a
 * room), and ground that lies around all others (`ground`).
 *
 * The common density is chosen so that all lightmaps together have about `target` texels. */
#ifndef KILN_COORDINATOR_LAYOUT_DENSITY_H
#define KILN_COORDINATOR_LAYOUT_DENSITY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"

#define KILN_DENSITY_SPREAD 1.75

/* An object's lightmap at one texel a metre. */
struct kiln_density_demand {
    double area;   /* m2 of its surface; determines the largest object */
    double texels; /* texels of the whole lightmap; 0: the object has no area */
    double longer; /* texels along the longer side */
    bool ground;   /* flat, 100 m long, and 4 times as wide and long as all other objects together: a vast object */
    double factor; /* a factor on the object's texels a metre, applied before the limits; normally 1 */
    /* root of the mean number of texels per m2 of the surface, at one texel a metre: above 1 in uneven layouts, which
     * have more texels than their side lengths suggest */
    double mean;
};

struct kiln_density {
    double texels_per_metre; /* density of all objects but the exceptions */
    double most_texels;      /* the most texels that an object may have */
    uint32_t least_side;     /* the fewest texels along the longer side of a lightmap */
    size_t largest;          /* object whose density bounds the others; SIZE_MAX: no object has any area */
    double *of;              /* per object: its texels a metre */
};

/* Chooses the densities. Deterministic. The caller frees `density->of` with kiln_free. Without any area the density is
 * 1. */
int kiln_density_choose(struct kiln_density *density, const struct kiln_density_demand *demands, size_t count,
                        double target, struct kiln_error *error);

#endif
