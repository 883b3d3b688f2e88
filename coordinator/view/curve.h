/* Scaling plot: parallel efficiency over the number of ranks, as SVG. */
#ifndef KILN_COORDINATOR_VIEW_CURVE_H
#define KILN_COORDINATOR_VIEW_CURVE_H

#include <stddef.h>

#include "worker/base/status.h"

/* The curves, in the order of `values` below: strong scaling of the whole bake, and of light and exchange alone; the
 * same two for weak scaling. Efficiency 1 is ideal. */
enum { KILN_CURVES = 4 };

/* Publishes DIRECTORY/scaling.svg, with `count` numbers of ranks (above 0, ascending) on a logarithmic axis and
 * efficiencies from 0 to 1, or to the largest value. Not collective. */
int kiln_curve_write(const char *directory, const char *title, const double *ranks,
                     const double *const values[KILN_CURVES], size_t count, struct kiln_error *error);

#endif
