/* Cache of chart graphs shared by lightmaps. Lightmaps of one mesh and size have the same graph, as with repeated
 * meshes in a scene. Any thread may take and give back. Not collective. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_CHARTS_CHART_GRAPHS_H
#define KILN_COORDINATOR_OUTPUT_MAP_CHARTS_CHART_GRAPHS_H

#include "coordinator/output/map/charts/chart_graph.h"

struct kiln_chart_graphs;

/* Number of unused graphs that are kept for later use. */
enum { KILN_CHART_GRAPHS_IDLE = 16 };

/* Borrows the scene. KILN_SYSTEM. */
int kiln_chart_graphs_create(struct kiln_chart_graphs **graphs, const struct kiln_scene *scene,
                             struct kiln_error *error);
/* Announces that a graph of the mesh will be taken once more. Once as many were given back, none is kept of that mesh.
 * Before any is taken. */
void kiln_chart_graphs_expect(struct kiln_chart_graphs *graphs, uint32_t mesh);
/* Destroys the cache; all graphs must have been given back. */
void kiln_chart_graphs_destroy(struct kiln_chart_graphs **graphs);

/* Returns the graph from the cache, or creates it like kiln_chart_graph_create, with its errors; waits while another
 * thread creates it. The graph is borrowed until it is given back. `width`, `height`: texels. */
int kiln_chart_graphs_take(struct kiln_chart_graphs *graphs, uint32_t mesh, uint32_t width, uint32_t height,
                           const struct kiln_chart_graph **graph, struct kiln_error *error);
/* Number of graphs in the cache, used or not. */
size_t kiln_chart_graphs_held(const struct kiln_chart_graphs *graphs);
/* Sets *graph to NULL; may be NULL already. */
void kiln_chart_graphs_give_back(struct kiln_chart_graphs *graphs, const struct kiln_chart_graph **graph);

#endif
