/* Charts: connected pieces of a mesh, each with a plane onto which it projects without overlap. */
#ifndef KILN_COORDINATOR_LAYOUT_CHARTS_H
#define KILN_COORDINATOR_LAYOUT_CHARTS_H

#include <stdbool.h>

#include "coordinator/layout/topology.h"

/* A point p of the chart lies at (u . p + offset[0], v . p + offset[1]) in 0..width x 0..height, in metres. The axes
 * are orthogonal and scaled so that the chart's area there is its area on the surface. */
struct kiln_chart {
    uint32_t first, count; /* triangles, in `order` */
    struct kiln_dvec3 u, v;
    double offset[2];
    double width, height;
    double area;      /* m2 */
    bool rectangular; /* fills its bounding box */
};

struct kiln_charts {
    size_t count;
    struct kiln_chart *charts;
    size_t capacity;
    uint32_t *order; /* triangles, chart by chart; degenerate ones are left out */
    size_t order_count;
};

/* Projection is along the mean normal or, where that would be steeper than KILN_CHART_CONE somewhere, along the axis of
 * the normals' cone. A chart whose projection overlaps itself (tested by samples, 8 a texel of `texels_per_metre` each
 * way, between 128 and 8192 across the chart) is cut in two halves of near equal size until none does. Charts are
 * turned so that their bounding box is as small as can be. Deterministic. Destroy with kiln_charts_destroy. */
int kiln_charts_create(struct kiln_charts **charts, const struct kiln_topology *topology, double texels_per_metre,
                       struct kiln_error *error);
void kiln_charts_destroy(struct kiln_charts **charts);

static inline void kiln_chart_project(const struct kiln_chart *chart, struct kiln_dvec3 p, double uv[2])
{
    uv[0] = dvec3_dot(chart->u, p) + chart->offset[0];
    uv[1] = dvec3_dot(chart->v, p) + chart->offset[1];
}

#endif
