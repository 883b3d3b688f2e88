/* A plot as SVG with two logarithmic axes: an error, shown in per cent, over seconds, or other quantities. Nothing here
 * is collective. */
#ifndef KILN_COORDINATOR_BENCH_LOG_PLOT_H
#define KILN_COORDINATOR_BENCH_LOG_PLOT_H

#include "coordinator/files/html.h"

/* Of the picture, and of its margins around the axes, pixels. */
enum {
    KILN_LOG_PLOT_WIDTH = 860,
    KILN_LOG_PLOT_HEIGHT = 560,
    KILN_LOG_PLOT_LEFT = 78,
    KILN_LOG_PLOT_RIGHT = 150,
    KILN_LOG_PLOT_TOP = 48,
    KILN_LOG_PLOT_BOTTOM = 58
};

struct kiln_log_plot {
    double low[2], high[2]; /* of seconds and of the error, as log10 */
    const char *unit[2];    /* behind the numbers of the axes: " s" and " %" */
    double factor[2];       /* on values, for these numbers: 1 and 100 */
};

/* A plot of no points. Then come all points with kiln_log_plot_include, and kiln_log_plot_fit. */
struct kiln_log_plot kiln_log_plot_empty(void);
/* Both must be above 0 and finite. */
void kiln_log_plot_include(struct kiln_log_plot *plot, double seconds, double error);
/* Adds margins, so that the points do not lie on the border. */
void kiln_log_plot_fit(struct kiln_log_plot *plot);

/* Places in the picture, pixels from its left and from its top. */
double kiln_log_plot_across(const struct kiln_log_plot *plot, double seconds);
double kiln_log_plot_up(const struct kiln_log_plot *plot, double error);

/* Begins the picture: title and scene, axes with their names. The caller ends it with </svg>. */
void kiln_log_plot_begin(struct kiln_html *page, const struct kiln_log_plot *plot, const char *title, const char *scene,
                         const char *across, const char *up);

#endif
