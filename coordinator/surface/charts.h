/* Charts of the lightmap layouts: triangles that hang together through corners with equal position and equal
 * coordinate. */
#ifndef KILN_COORDINATOR_SURFACE_CHARTS_H
#define KILN_COORDINATOR_SURFACE_CHARTS_H

#include "worker/scene/scene.h"

/* Gives for each stored vertex of the meshes that `wanted` marks (NULL: all) its chart: two triangles of a mesh are of
 * one chart if their corners' entries are equal. Free with kiln_free. Not collective. KILN_SYSTEM. */
int kiln_charts_find(uint32_t **vertex_chart, const struct kiln_scene *scene, const uint8_t *wanted, uint32_t threads,
                     struct kiln_error *error);

#endif
