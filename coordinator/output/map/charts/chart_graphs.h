/* Chart graphs that lightmaps share: those of one mesh and size, as many objects of a scene that repeats its meshes
 * are, have the same. Any thread may take and give back. Not collective. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_CHARTS_CHART_GRAPHS_H
#define KILN_COORDINATOR_OUTPUT_MAP_CHARTS_CHART_GRAPHS_H

#include "coordinator/output/map/charts/chart_graph.h"

struct kiln_chart_graphs;

/* Graphs that nobody has, and that are kept for whoever wants one next. */
enum { KILN_CHART_GRAPHS_IDLE = 16 };

/* Borrows the scene. KILN_SYSTEM. */
int kiln_chart_graphs_create(struct kiln_chart_graphs **graphs, const struct kiln_scene *scene,
                             struct kiln_error *error);
/* All must have been given back. */
void kiln_chart_graphs_destroy(struct kiln_chart_graphs **graphs);

/* As kiln_chart_graph_create, with its errors, if there is none; waits while another thread makes it. The graph is
 * borrowed until it is given back. `width`, `height`: texels. */
int kiln_chart_graphs_take(struct kiln_chart_graphs *graphs, uint32_t mesh, uint32_t width, uint32_t height,
                           const struct kiln_chart_graph **graph, struct kiln_error *error);
/* Sets *graph to NULL; may be NULL already. */
void kiln_chart_graphs_give_back(struct kiln_chart_graphs *graphs, const struct kiln_chart_graph **graph);

#endif
