/* Private to the sources of kiln bench radiosity. */
#ifndef KILN_COORDINATOR_BENCH_RADIOSITY_PRIVATE_H
#define KILN_COORDINATOR_BENCH_RADIOSITY_PRIVATE_H

#include "coordinator/bench/sweep.h"

enum { KILN_PICTURE_NAME = 80 };

/* The file of a bake's picture, below the output; with the ending "-difference" that of how far the lightmap that
 * differs most is from the pure one's. */
void kiln_radiosity_picture(const struct kiln_setting *setting, const char *ending, char name[KILN_PICTURE_NAME]);
/* Likewise of what a texel sees, by a grid of so many voxels along, or by rays: 0. */
void kiln_radiosity_seen_picture(uint32_t along, char name[KILN_PICTURE_NAME]);
/* Whether a bake has this group's name. */
bool kiln_radiosity_is(const struct kiln_setting *setting, const char *group);

/* radiosity_figures.c */
extern const struct kiln_sweep_file kiln_radiosity_files[];
void kiln_radiosity_plot(const struct kiln_sweep *sweep, struct kiln_html *page);

#endif
