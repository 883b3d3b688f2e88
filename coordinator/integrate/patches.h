/* What a bake by radiosity (radiosity/radiosity.h) gathers from: the patches of all surface points, on every rank, and
 * the nodes of a step made of them (worker/pass/patches.h).
 *
 * Each point that sends light is a node; or nodes stand for squares of texels of one lightmap (Kahl, "RTX Radiosity",
 * 2023, sections 5.1.1 to 5.1.3). Four squares are joined to one, from the single texels up, if none of them holds
 * several nodes, and if they lie beside each other and look one way within 25 degrees: so a node never has texels of
 * two charts, but of such as go on into each other. A node's area is that of its texels that are there.
 *
 *   --undersample stride   a window of W x W texels has the radiosity and the place of its first texel
 *                 random   of one of them by chance, another one in each step, in proportion to their areas
 *                 mipmap   their mean radiosity, at their middle; rays go to the place of a texel by it
 *   --subdivide X          likewise the mean, where max |B - mean| / 2 + max |n - mean| / 2 level is below X level,
 * over all four and the largest channel; level is the mean radiosity of all points in the step. Up to N x N texels
 * (--node-max)
 *
 * A rank keeps 60 bytes for each surface point of the scene, and 84 for each node. */
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
