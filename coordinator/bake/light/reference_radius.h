/* Median texel width: it sets the radius of merging with --method vcm where none is given (worker/pass/reference.h).
 * Private to coordinator. */
#ifndef KILN_COORDINATOR_BAKE_LIGHT_REFERENCE_RADIUS_H
#define KILN_COORDINATOR_BAKE_LIGHT_REFERENCE_RADIUS_H

#include <mpi.h>

#include "worker/scene/surface.h"

/* Collective. Computes the width of the scene's median texel, m, rounded to a power of 2^(1/8); 0 without points.
 * `surface` has this rank's points. The median represents most of a bake, just as views use the median depth
 * (coordinator/view/view_radius.h): a terrain of a few large texels does not change it. All ranks get the same width,
 * however the points are distributed. KILN_SYSTEM. */
int kiln_median_texel(const struct kiln_surface *surface, MPI_Comm communicator, double *width,
                      struct kiln_error *error);

#endif
