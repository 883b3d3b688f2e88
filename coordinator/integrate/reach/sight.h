/* The visibility grid: for each unit of the surface the units that rays from its points meet (Vandersanden, "Radiance
 * cells: distributed light baking", 2023, chapter 6). Units are cells, or with partition by objects lightmaps, cut into
 * pieces of 32 points that follow one another in the global order (in a surface of more than 2^21 points: of a 65,536th
 * of all), which are patches of one wall or a few things. The grid is sampled, so it may miss a pair; and it is made
 * whole by symmetry: who is seen sees. Nodes ask only for the radiosity of what their points see
 * (coordinator/field/radiosity_allgather.h); what the grid has missed is found in second_go.h.
 *
 * The rays are those of a gather: places even over the points, directions by the cosine, at least 8 for each point and
 * 512 for each unit, but at most 32 for each point. They are a function of seed and point, so the grid is the same for
 * any number of ranks. */
#ifndef KILN_COORDINATOR_INTEGRATE_REACH_SIGHT_H
#define KILN_COORDINATOR_INTEGRATE_REACH_SIGHT_H

#include "coordinator/integrate/integrate.h"

/* Collective. Makes the grid for the points as the ranks have them. Destroy with kiln_sight_destroy. */
int kiln_sight_create(struct kiln_sight **sight, const struct kiln_integrate_params *params, struct kiln_error *error);
/* Collective. Makes the pairs anew, after points were moved to other ranks. */
int kiln_sight_look(struct kiln_sight *sight, const struct kiln_integrate_params *params, struct kiln_error *error);

/* Collective. The nodes of the exchange want what their ranks' units see, and nothing else. `now`: and receive its
 * present values. With the fault KILN_SIGHT=none they see nothing. */
int kiln_sight_want(const struct kiln_sight *sight, const struct kiln_integrate_params *params,
                    struct kiln_radiosity_allgather *allgather, bool now, struct kiln_error *error);

#endif
