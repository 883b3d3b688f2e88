/* Seam smoothing: changes texels so that bilinear filtering gives the same value on both sides of a seam, by the least
 * squares of seam_system.h.
 *
 * Every seam has samples at most half a texel apart. They read texels of the surface and of the margin. A margin texel
 * begins as a copy of a surface texel and has the least weight. So where there is a margin, the margin takes the values
 * from beyond the seam, and the surface changes little. Where there is none, at the edge of the image or between charts
 * that lie close together, the surface texels on both sides approach each other. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_SEAMS_SEAMS_H
#define KILN_COORDINATOR_OUTPUT_MAP_SEAMS_SEAMS_H

#include "coordinator/output/map/charts/chart_graph.h"
#include "coordinator/output/map/map.h"

struct kiln_seam_report {
    uint64_t samples; /* samples that were used */
    double mean;      /* mean luminance of direct + indirect over the object's surface texels */
    /* root mean square over the samples of the difference in luminance / mean */
    double difference_before, difference_after;
};

/* Smooths at seams the planes of the map marked `smooth`; with `smooth` false only measures the differences. `nearest`
 * is the result of kiln_nearest_texels with KILN_TEXEL_FILLED and kiln_borders_assign; a margin texel that gets a value
 * of its own becomes its own nearest one. The map must be filled; this function fills the margin with copies.
 * Deterministic. Not for a map in bands, whose seams are solved by all ranks (joined.h). */
int kiln_seams_smooth(struct kiln_map *map, const struct kiln_chart_graph *graph, uint32_t *nearest, bool smooth,
                      struct kiln_seam_report *report, struct kiln_error *error);

#endif
