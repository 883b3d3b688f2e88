/* A plot of efficiency over ranks, as SVG, for scaling studies and simulations. */
#ifndef KILN_COORDINATOR_VIEW_CURVE_H
#define KILN_COORDINATOR_VIEW_CURVE_H

#include <stddef.h>

#include "worker/base/status.h"

/* In the order of the values below; efficiency 1: all of what is ideal. */
enum { KILN_CURVES = 4 }; /* strong scaling: all of the bake, light and exchange alone; weak scaling: the same two */

/* Publishes DIRECTORY/scaling.svg: `count` ranks (above 0, ascending) on a logarithmic axis, the efficiencies from 0 to
 * 1 (more, where there are). Not collective. */
int kiln_curve_write(const char *directory, const char *title, const double *ranks,
                     const double *const values[KILN_CURVES], size_t count, struct kiln_error *error);

#endif
