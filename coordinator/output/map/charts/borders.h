/* Assignment of margin texels to charts, by the charts that read them.
 *
 * Bilinear filtering reads four texels around a sample point. So along its border a chart reads texels of the margin
 * and, where charts lie too close together, texels of other charts. Every border is sampled in steps of at most a
 * quarter of a texel. The weight with which a chart reads a texel is
 *
 *     w = sum over the steps of (bilinear weight)^2 x length,
 *
 * so that w (x - v)^2 is the squared error along the border if the texel holds x and the chart needs v, the value of
 * the chart's nearest texel. A margin texel that one chart reads gets the value of that chart's nearest texel. If
 * several charts read it, the layout has too little padding; it then gets the value of that nearest texel which
 * minimises the sum of the squared errors, relative to the value that each chart needs. A margin texel that no chart
 * reads is not changed. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_CHARTS_BORDERS_H
#define KILN_COORDINATOR_OUTPUT_MAP_CHARTS_BORDERS_H

#include "coordinator/output/map/charts/chart_graph.h"
#include "coordinator/output/map/map.h"

struct kiln_border_report {
    uint64_t contested;      /* margin texels that several charts read */
    uint64_t foreign;        /* texels of a chart read by the border of another chart, counted once per reading chart */
    uint64_t looked_at;      /* claims looked at (claims.h): the work done, linear in the length of the borders */
    double length;           /* of that, where a texel has the value of another chart */
    double length_disturbed; /* of that, where a texel is read that has the value of another chart */
};

/* Updates `nearest` (from kiln_nearest_texels with KILN_TEXEL_FILLED) at margin texels that a chart reads. The map must
 * be filled, with the chart numbers of the graph. Time and memory are linear in the number of texels and the length of
 * the borders. Collective if the map is one of bands, with charts and planes of KILN_BANDS_HALO rows around;
 * deterministic.
 */
int kiln_borders_assign(struct kiln_map *map, const struct kiln_chart_graph *graph, uint32_t *nearest,
                        struct kiln_border_report *report, struct kiln_error *error);

#endif
