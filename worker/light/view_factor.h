/* View factors from a small piece of surface to a parallelogram: the share of the piece's diffuse emission that would
 * arrive at the parallelogram if nothing lay between. Pure functions. */
#ifndef KILN_WORKER_LIGHT_VIEW_FACTOR_H
#define KILN_WORKER_LIGHT_VIEW_FACTOR_H

#include "worker/base/vector.h"

/* A parallelogram, m, as seen from the piece: its centre, and the edges from a corner. */
struct kiln_parallelogram {
    struct kiln_dvec3 centre, edge_s, edge_t;
};

/* Returns the view factor with cosines about the unit normal `about`. Only the part of the parallelogram above the
 * horizons of both `about` and the unit normal n counts. Pass a shading normal as `about`, or n itself for the plain
 * factor. Either face of the parallelogram counts. Lambert's formula for polygons (1760; Baum, Rushmeier and Winget,
 * "Improving Radiosity Solutions Through the Use of Analytically Determined Form-Factors", SIGGRAPH 1989, equation 9),
 * exact but for an absolute rounding error of 1e-9, which matters if the parallelogram is far away. */
double kiln_view_factor_near(const struct kiln_parallelogram *parallelogram, struct kiln_dvec3 n,
                             struct kiln_dvec3 about);

#endif
