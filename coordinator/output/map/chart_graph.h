/* How the triangles of a mesh hang together on its lightmap layout: which chart each is in, where charts end, and where
 * they meet in space. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_CHART_GRAPH_H
#define KILN_COORDINATOR_OUTPUT_MAP_CHART_GRAPH_H

#include "worker/scene/scene.h"

/* An edge that two charts (or two parts of one) share in space but not on the layout. Texel coordinates: uv x size. End
 * e of side 0 and end e of side 1 are the same point in space. */
struct kiln_seam_edge {
    float texel[2][2][2]; /* side, end, x y */
};

/* An edge of a triangle beyond which its chart does not go on. */
struct kiln_border_edge {
    uint32_t chart;
    float texel[2][2]; /* end, x y */
};

struct kiln_chart_graph {
    size_t triangle_count, chart_count, edge_count, border_count;
    uint32_t *chart; /* one a triangle of the mesh */
    struct kiln_seam_edge *edges;
    struct kiln_border_edge *borders; /* by triangle; none is a point on the layout */
};

/* Shading normals that differ more than this at either end make a hard edge, where irradiance may jump: no seam. */
#define KILN_SEAM_COSINE 0.9986f /* 3 degrees */

/* For the mesh's layout at a lightmap size of width x height texels. Vertices at exactly the same position are one
 * point in space. Not collective; deterministic. */
int kiln_chart_graph_create(struct kiln_chart_graph **graph, const struct kiln_scene *scene, uint32_t mesh,
                            uint32_t width, uint32_t height, struct kiln_error *error);
void kiln_chart_graph_destroy(struct kiln_chart_graph **graph);

#endif
