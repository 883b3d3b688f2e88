/* Charts of the lightmap layouts: sets of triangles connected through corners with equal position and equal lightmap
 * coordinate. */
#ifndef KILN_COORDINATOR_SURFACE_CHARTS_H
#define KILN_COORDINATOR_SURFACE_CHARTS_H

#include "worker/scene/scene.h"

/* Finds the chart of each stored vertex of the meshes that `wanted` marks (NULL: all meshes). Two triangles of a mesh
 * belong to one chart exactly if their corners have equal entries in `vertex_chart`. The caller frees *vertex_chart
 * with kiln_free. Not collective. KILN_SYSTEM. */
int kiln_charts_find(uint32_t **vertex_chart, const struct kiln_scene *scene, const uint8_t *wanted, uint32_t threads,
                     struct kiln_error *error);

#endif
