/* Charts: connected pieces of a mesh, each with a plane onto which it projects without overlap. */
#ifndef KILN_COORDINATOR_LAYOUT_CHARTS_H
#define KILN_COORDINATOR_LAYOUT_CHARTS_H

#include <stdbool.h>

#include "coordinator/layout/topology.h"

/* A position p on the chart maps to (u . p + offset[0], v . p + offset[1]) in 0..width x 0..height, in metres. The axes
 * are orthogonal and scaled so that the chart's projected area equals its area on the surface. */
struct kiln_chart {
    uint32_t first, count; /* its triangles: a range of `order` */
    struct kiln_dvec3 u, v;
    double offset[2];
    double width, height;
    double area;      /* m2 */
    bool rectangular; /* it fills its bounding box */
};

struct kiln_charts {
    size_t count;
    struct kiln_chart *charts;
    size_t capacity;
    uint32_t *order; /* triangle numbers, chart by chart; degenerate triangles are left out */
    size_t order_count;
};

/* Makes charts from the segments of the mesh (segment.h). A chart is projected along its mean normal or, where that
 * makes an angle of more than KILN_CHART_CONE with some normal, along the axis of the cone of normals. A chart whose
 * projection overlaps itself is split into two halves of nearly equal size until none does; overlap is tested by
 * samples, 8 per texel of `texels_per_metre` in each direction, between 128 and 8192 across the chart. Charts are
 * rotated to the smallest bounding box. Deterministic. Destroy with kiln_charts_destroy. */
int kiln_charts_create(struct kiln_charts **charts, const struct kiln_topology *topology, double texels_per_metre,
                       struct kiln_error *error);
void kiln_charts_destroy(struct kiln_charts **charts);

/* Maps a position on the chart, m, to its plane, m. */
static inline void kiln_chart_project(const struct kiln_chart *chart, struct kiln_dvec3 p, double uv[2])
{
    uv[0] = dvec3_dot(chart->u, p) + chart->offset[0];
    uv[1] = dvec3_dot(chart->v, p) + chart->offset[1];
}

#endif
