/* Which chart a texel of the margin belongs to, decided by who reads it.
 *
 * A sampler reads the four texels around a place. Along its border a chart thus reads texels of the margin (and, where
 * charts stand too close, texels of other charts). Every border is walked in steps of at most a quarter of a texel;
 * what a chart reads of a texel is
 *
 *     w = sum over the steps of (bilinear weight)^2 x length,
 *
 * so that w (x - v)^2 is the squared error along the border when the texel holds x and the chart would have v there:
 * the value of the chart's nearest texel. A margin texel that one chart reads stands for that chart's nearest texel.
 * Where several read one, the layout has too little padding: of their nearest texels that one is taken which makes the
 * sum of squared errors, relative to what each chart would have, least. A margin texel that nobody reads keeps what it
 * stands for. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_BORDERS_H
#define KILN_COORDINATOR_OUTPUT_MAP_BORDERS_H

#include "coordinator/output/map/chart_graph.h"
#include "coordinator/output/map/map.h"

struct kiln_border_report {
    uint64_t contested;      /* margin texels that several charts read */
    uint64_t foreign;        /* texels of a chart that another one's border reads: counted once a chart that reads it */
    double length;           /* texels of border */
    double length_disturbed; /* of it, where a texel is read that stands for another chart */
};

/* Changes `nearest` (from kiln_nearest_texels with KILN_TEXEL_FILLED) at margin texels that some chart reads. The map
 * is filled; its chart numbers are the graph's. Time and memory are linear in texels and length of border. Not
 * collective; deterministic. */
int kiln_borders_assign(const struct kiln_map *map, const struct kiln_chart_graph *graph, uint32_t *nearest,
                        struct kiln_border_report *report, struct kiln_error *error);

#endif
