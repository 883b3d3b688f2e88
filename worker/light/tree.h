/* The light tree: private to worker/light. */
#ifndef KILN_WORKER_LIGHT_TREE_H
#define KILN_WORKER_LIGHT_TREE_H

#include "worker/light/lights.h"

/* Builds lights->nodes over all area and point lights. */
int kiln_light_tree_build(struct kiln_lights *lights, struct kiln_error *error);

/* About the irradiance that the cluster may bring to points within `spread` metres of p (normal n; n = 0: any): power
 * bound x cosines over squared distance, zero only where it is surely zero. Conty Estevez and Kulla 2018, section 4. */
double kiln_light_node_importance(const struct kiln_light_node *node, struct kiln_dvec3 p, double spread,
                                  struct kiln_dvec3 n);

#endif
