/* Private to the sources of kiln bench tradeoff. */
#ifndef KILN_COORDINATOR_BENCH_TRADEOFF_PRIVATE_H
#define KILN_COORDINATOR_BENCH_TRADEOFF_PRIVATE_H

#include "coordinator/bench/sweep.h"

/* tradeoff_settings.c. Lists the bakes of the groups that are named, or of all, after those whose samples are given.
 * KILN_USAGE for a group that there is none of. */
int kiln_settings_choose(struct kiln_sweep *sweep, struct kiln_error *error);
/* The options of a bake, as words with a blank between. `density`: of the reference. */
void kiln_setting_options(const struct kiln_setting *setting, double density, char text[KILN_SETTING_OPTIONS]);
/* Rays for each texel, as a measure of how long the bake takes. */
double kiln_setting_rays(const struct kiln_setting *setting);

/* tradeoff_front.c. Whether a bake is on the front: no other has less time and no more error, or less error and no more
 * time. */
void kiln_front_mark(struct kiln_sweep *sweep);
/* The bakes of the front by time, at most KILN_SETTINGS_MOST; returns their number. */
size_t kiln_front_list(const struct kiln_sweep *sweep, size_t *indices);
/* The time in which the front, without the presets, has an error: between two bakes of it the logarithms are
 * interpolated. NaN beyond its ends. */
double kiln_front_seconds(const struct kiln_sweep *sweep, double error);

/* tradeoff_plot.c */
void kiln_tradeoff_plot(const struct kiln_sweep *sweep, struct kiln_html *page);

/* tradeoff_tell.c. Prints the front and the sentences on what to choose, as text or JSON. */
int kiln_tradeoff_tell(const struct kiln_sweep *sweep, size_t left, struct kiln_error *error);
void kiln_tradeoff_list(const struct kiln_sweep *sweep);

#endif
