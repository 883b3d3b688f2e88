/* A plot of efficiency over ranks, as SVG, for scaling studies and simulations. */
#ifndef KILN_COORDINATOR_OUTPUT_CURVE_H
#define KILN_COORDINATOR_OUTPUT_CURVE_H

#include <stddef.h>

#include "worker/base/status.h"

struct kiln_curve {
    const char *name;     /* in the legend */
    const double *ranks;  /* above 0, ascending */
    const double *values; /* 1: all of what is ideal */
    size_t count;
};

/* Publishes an SVG: ranks on a logarithmic axis, values from 0 to 1 (more, where there are). At most 6 curves. */
int kiln_curve_svg(const char *path, const char *title, const struct kiln_curve *curves, size_t count, struct kiln_error *error);

#endif
