/* Automatic density: how many texels a metre each object of a scene gets when the user gives no density.
 *
 * All objects get the same density, with two exceptions:
 * - An object that would take more than its allowed fraction of all texels (a ground plane around a house) gets that
 *   fraction. The fraction is a quarter; with fewer than four objects, which cannot all stay below a quarter, it is one
 *   over their number.
 * - An object whose lightmap would be less than a few texels across gets those few texels.
 *
 * The common density is chosen so that all lightmaps together have about `target` texels. */
#ifndef KILN_COORDINATOR_LAYOUT_DENSITY_H
#define KILN_COORDINATOR_LAYOUT_DENSITY_H

#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"

/* An object's lightmap at one texel a metre. */
struct kiln_density_demand {
    double texels; /* texels of the whole lightmap; 0: the object has no area */
    double longer; /* texels along the longer side */
    double factor; /* a factor on the object's texels a metre, applied before the limits; normally 1 */
};

struct kiln_density {
    double texels_per_metre; /* density of all objects but the exceptions */
    double most_texels;      /* the most texels that an object may have */
    uint32_t least_side;     /* the fewest texels along the longer side of a lightmap */
    double *of;              /* per object: its texels a metre */
};

/* Chooses the densities. Deterministic. The caller frees `density->of` with kiln_free. Without any area the density is
 * 1. */
int kiln_density_choose(struct kiln_density *density, const struct kiln_density_demand *demands, size_t count,
                        double target, struct kiln_error *error);

#endif
