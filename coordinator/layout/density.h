/* Automatic density: how many texels a metre each object of a scene gets, when the user names no density.
 *
 * All objects have the same density, except
 * - those that would take more than their share of all texels (a ground plane around a house): they get that share;
 * - those that would be less than a few texels across: they get so many.
 * The share is a quarter; with fewer than four objects, who cannot all stay below a quarter, it is what an even split
 * gives each. The common density is such that all lightmaps together have about `target` texels. */
#ifndef KILN_COORDINATOR_LAYOUT_DENSITY_H
#define KILN_COORDINATOR_LAYOUT_DENSITY_H

#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"

/* An object's lightmap at one texel a metre. */
struct kiln_density_demand {
    double texels; /* of the whole lightmap; 0: the object has no area */
    double longer; /* the longer side, texels */
    double factor; /* on the texels a metre, before shares are dealt; 1 */
};

struct kiln_density {
    double texels_per_metre; /* what all objects have but those below */
    double most_texels;      /* that an object may have */
    uint32_t least_side;     /* texels that the longer side of a lightmap has at least */
    double *of;              /* an object: its texels a metre */
};

/* Deterministic. `density->of` is the caller's to free with kiln_free. Without a demand the density is 1. */
int kiln_density_choose(struct kiln_density *density, const struct kiln_density_demand *demands, size_t count,
                        double target, struct kiln_error *error);

/* The nearest, by ratio, of ten round numbers a decade. */
double kiln_density_tidy(double value);

#endif
