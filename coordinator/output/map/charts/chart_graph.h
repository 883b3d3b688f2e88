/* Chart graph: the charts of a mesh on its lightmap layout, their borders, and the seams where charts meet in space. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_CHARTS_CHART_GRAPH_H
#define KILN_COORDINATOR_OUTPUT_MAP_CHARTS_CHART_GRAPH_H

#include "worker/base/arena.h"
#include "worker/scene/scene.h"

/* A seam: an edge of two charts, or twice of one chart, that is one edge in space but two edges on the layout. Texel
 * coordinates are uv x size. End e of side 0 and end e of side 1 are the same point in space. */
struct kiln_seam_edge {
    float texel[2][2][2]; /* side, end, x y */
};

/* A border: an edge of a triangle at which its chart ends. */
struct kiln_border_edge {
    uint32_t chart;
    float texel[2][2]; /* end, x y */
};

struct kiln_chart_graph {
    size_t triangle_count, chart_count, edge_count, border_count;
    uint32_t *chart; /* of each triangle of the mesh */
    struct kiln_seam_edge *edges;
    struct kiln_border_edge *borders; /* in the order of triangles; edges of length 0 on the layout are left out */
    struct kiln_arena arena;
};

/* Edges at either end of which the shading normals differ by more than this are hard edges, at which irradiance may
 * jump. They are not seams. */
#define KILN_SEAM_COSINE 0.9986f /* 3 degrees */

/* Creates the graph of a mesh for a lightmap of width x height texels. Vertices at exactly the same position are one
 * point in space. Not collective; deterministic. */
int kiln_chart_graph_create(struct kiln_chart_graph **graph, const struct kiln_scene *scene, uint32_t mesh,
                            uint32_t width, uint32_t height, struct kiln_error *error);
void kiln_chart_graph_destroy(struct kiln_chart_graph **graph);

/* Finds the edges at which the surface of a mesh ends or folds: those without another triangle of the mesh beyond whose
 * normals are similar (KILN_SEAM_COSINE). Bit k of (*ends)[t] is set for the edge of triangle t from corner k to the
 * next. *ends is allocated: one byte a triangle. Not collective; deterministic. */
int kiln_mesh_ends(uint8_t **ends, const struct kiln_scene *scene, uint32_t mesh, struct kiln_error *error);

#endif
