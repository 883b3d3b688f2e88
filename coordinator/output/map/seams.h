/* Making the two sides of a seam agree under bilinear filtering.
 *
 * Along every seam edge, samples half a texel apart or closer ask for the same bilinear value on both sides; a texel of
 * the margin in a sample's footprint stands for the surface texel that will be copied into it. For each plane
 *
 *     sum over samples (value on side 0 - value on side 1)^2 + w sum over texels a (x - baked)^2   is made smallest
 *
 * over the texels in the footprints, with a a texel's area over the mean (at least 0.1) and w = KILN_SEAM_WEIGHT, by
 * conjugate gradients (after Iwanicki, "Lighting technology of The Last of Us", 2013). Both sides' weights sum to one,
 * so the sum of a x is what it was: energy moves across the seam and none is made. A result outside the range of the
 * baked values around it is brought back to that range. Planes are solved apart, so direct + indirect = total holds as
 * before. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_SEAMS_H
#define KILN_COORDINATOR_OUTPUT_MAP_SEAMS_H

#include "coordinator/output/map/map.h"
#include "coordinator/output/map/chart_graph.h"

#define KILN_SEAM_WEIGHT 0.02

/* A difference larger than this factor is an edge of light standing on the seam (a wall between two rooms), not an
 * error of sampling: such samples ask for nothing, and black stays black. */
#define KILN_SEAM_CONTRAST 8.0f

struct kiln_seam_report {
    uint64_t samples; /* that asked for something */
    double mean;      /* mean luminance of direct + indirect over the object's surface texels */
    /* root mean square over samples of the difference in luminance / mean */
    double difference_before, difference_after;
};

/* Changes the map's direct and indirect planes at texels of seams; `nearest` as from kiln_nearest_texels with
 * KILN_TEXEL_FILLED, and kiln_borders_assign. With smooth false only measures. The map is filled; its margin need not
 * be. Deterministic. */
int kiln_seams_smooth(struct kiln_map *map, const struct kiln_chart_graph *graph, const uint32_t *nearest, bool smooth,
                      struct kiln_seam_report *report, struct kiln_error *error);

#endif
