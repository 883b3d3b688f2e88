/* View factors from a small piece of surface to a parallelogram: the share of what leaves the piece, by the cosine,
 * that would meet the parallelogram if nothing lay between. Pure functions. */
#ifndef KILN_WORKER_LIGHT_VIEW_FACTOR_H
#define KILN_WORKER_LIGHT_VIEW_FACTOR_H

#include "worker/base/vector.h"

/* A parallelogram, m, as seen from the piece: its centre, and the edges from a corner. */
struct kiln_parallelogram {
    struct kiln_dvec3 centre, edge_s, edge_t;
};

/* Returns the view factor about the unit normal `about` of the part that lies above its horizon and that of the unit
 * normal n: for irradiance about a shading normal. For the plain factor both are n. Either face of the parallelogram
 * counts. Lambert's formula for polygons (1760; Baum, Rushmeier and Winget, "Improving Radiosity Solutions Through the
 * Use of Analytically Determined Form-Factors", SIGGRAPH 1989, equation 9), exact but for rounding: 1e-9 of 1, which
 * counts where the parallelogram is far off. */
double kiln_view_factor_near(const struct kiln_parallelogram *parallelogram, struct kiln_dvec3 n,
                             struct kiln_dvec3 about);

#endif
