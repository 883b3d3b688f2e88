/* Seam smoothing: changes texels so that bilinear filtering gives the same value on both sides of a seam.
 *
 * Along every seam there are samples at distances of at most half a texel. A texel of the margin that a sample reads
 * stands for the surface texel that will be copied to it. For each plane the texels x that samples read minimise
 *
 *     sum over samples (value on side 0 - value on side 1)^2 + w sum over texels a (x - baked)^2,
 *
 * where a is the area of the texel relative to the mean area (at least 0.1) and w = KILN_SEAM_WEIGHT. The minimum is
 * found by conjugate gradients (after Iwanicki, "Lighting technology of The Last of Us", 2013). The bilinear weights of
 * both sides sum to one, so the sum of a x does not change: energy moves across the seam, and none is created. A result
 * outside the range of the baked values around it is clamped to that range. Planes are solved separately, so that
 * direct + indirect = total still holds. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_SEAMS_H
#define KILN_COORDINATOR_OUTPUT_MAP_SEAMS_H

#include "coordinator/output/map/map.h"
#include "coordinator/output/map/chart_graph.h"

#define KILN_SEAM_WEIGHT 0.02

/* If the values on both sides differ by more than this factor, the edge is one of the light, such as a wall between two
 * rooms on the seam, and not an error of sampling. Such samples are left out, and black stays black. */
#define KILN_SEAM_CONTRAST 8.0f

struct kiln_seam_report {
    uint64_t samples; /* samples that were used */
    double mean;      /* mean luminance of direct + indirect over the object's surface texels */
    /* root mean square over the samples of the difference in luminance / mean */
    double difference_before, difference_after;
};

/* Smooths the direct and indirect planes of the map at seams, or with `smooth` false only measures the differences.
 * `nearest` is the result of kiln_nearest_texels with KILN_TEXEL_FILLED and kiln_borders_assign. The map must be
 * filled, its margin need not be. Deterministic. */
int kiln_seams_smooth(struct kiln_map *map, const struct kiln_chart_graph *graph, const uint32_t *nearest, bool smooth,
                      struct kiln_seam_report *report, struct kiln_error *error);

#endif
