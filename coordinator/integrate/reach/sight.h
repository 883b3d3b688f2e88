/* The visibility grid: for each unit of the surface, the units that rays from its points hit (Vandersanden, "Radiance
 * cells: distributed light baking", 2023, chapter 6). Cells (with partition by objects, lightmaps) are cut into units
 * of 32 consecutive points in the global order (in a surface of more than 2^21 points: of a 65,536th of all). A unit is
 * a patch of one wall or a few things. The grid is sampled, so it may miss a pair; it is symmetric: a unit that is seen
 * sees the other. Nodes request only the radiosity of units that their points see
 * (coordinator/field/radiosity_allgather.h); second_go.h handles pairs that the grid missed.
 *
 * The rays are gather rays: origins even over the points, directions by the cosine, at least 8 for each point and 512
 * for each unit, but at most 32 for each point. They depend only on seed and point, so the grid is the same for any
 * number of ranks. */
#ifndef KILN_COORDINATOR_INTEGRATE_REACH_SIGHT_H
#define KILN_COORDINATOR_INTEGRATE_REACH_SIGHT_H

#include "coordinator/integrate/integrate.h"

/* Collective. Makes the grid for the current distribution of points. Destroy with kiln_sight_destroy. */
int kiln_sight_create(struct kiln_sight **sight, const struct kiln_integrate_params *params, struct kiln_error *error);
/* Collective. Recomputes the pairs, after points were moved to other ranks. */
int kiln_sight_look(struct kiln_sight *sight, const struct kiln_integrate_params *params, struct kiln_error *error);

/* Collective. Makes each node of the exchange request exactly the units that its ranks' units see. `now`: also receives
 * their present values. With the fault KILN_SIGHT=none they see nothing. */
int kiln_sight_want(const struct kiln_sight *sight, const struct kiln_integrate_params *params,
                    struct kiln_radiosity_allgather *allgather, bool now, struct kiln_error *error);

#endif
