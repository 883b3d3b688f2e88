/* Private to the sources of kiln bench cell-size and kiln bench per-object. */
#ifndef KILN_COORDINATOR_BENCH_ORDER_PRIVATE_H
#define KILN_COORDINATOR_BENCH_ORDER_PRIVATE_H

#include "coordinator/bench/sweep.h"

/* The bake that the setting is compared with: automatic cells, in order of cells, by as many ranks. */
bool kiln_order_is_usual(const struct kiln_setting *setting);

enum { KILN_ORDER_NAME = 24 };
/* Writes "auto / 8", "auto" or "auto x 2". */
void kiln_order_factor(double factor, char text[KILN_ORDER_NAME]);

/* order_plot.c. Time of light over the side of a cell, or over the orders of work; a line for each number of ranks. */
void kiln_order_plot(const struct kiln_sweep *sweep, struct kiln_html *page);

/* order_tell.c */
int kiln_order_tell(const struct kiln_sweep *sweep, size_t left, struct kiln_error *error);

#endif
