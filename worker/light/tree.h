/* The light tree: private to worker/light and to the backends. */
#ifndef KILN_WORKER_LIGHT_TREE_H
#define KILN_WORKER_LIGHT_TREE_H

#include "worker/light/lights.h"

/* Builds lights->nodes over all area and point lights. */
int kiln_light_tree_build(struct kiln_lights *lights, struct kiln_error *error);

/* Returns the bounds of a cluster, in the form that kiln_light_importance takes. */
struct kiln_light_bounds kiln_light_bounds_of(const struct kiln_light_node *node);

/* kiln_light_importance of the cluster. */
double kiln_light_node_importance(const struct kiln_light_node *node, struct kiln_dvec3 p, double spread,
                                  struct kiln_dvec3 n);

#endif
