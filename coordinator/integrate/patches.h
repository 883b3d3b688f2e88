/* What a bake by radiosity (radiosity/radiosity.h) gathers from: the patches of all surface points, on every rank, and
 * the nodes of a step made of them (worker/pass/patches.h).
 *
 * A rank keeps 56 bytes for each surface point of the scene, and 80 for each node. */
#ifndef KILN_COORDINATOR_INTEGRATE_PATCHES_H
#define KILN_COORDINATOR_INTEGRATE_PATCHES_H

#include "coordinator/integrate/integrate.h"

struct kiln_patches;

/* Borrows `params` and `solution`. Not collective. KILN_SYSTEM. */
int kiln_patches_create(struct kiln_patches **patches, const struct kiln_integrate_params *params,
                        struct kiln_solution *solution, struct kiln_error *error);
/* NULL is accepted. */
void kiln_patches_destroy(struct kiln_patches **patches);

/* Collective. Before the step last reported, which runs the patches pass, is computed or gone on with: makes its nodes,
 * of solution->radiosity, and gives the step its parameters, which stand until the next call or the end of the patches.
 * The first call of a run finds the shapes of all points. Any ranks get the same. */
int kiln_patches_update(struct kiln_patches *patches, struct kiln_error *error);

#endif
