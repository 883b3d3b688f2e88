/* The rounds of a bake, foretold by a trial of its light on processors (integrate/parts/light_trial.h). */
#ifndef KILN_COORDINATOR_BAKE_PREPARE_FORETELL_H
#define KILN_COORDINATOR_BAKE_PREPARE_FORETELL_H

#include "coordinator/bake/prepare/prepare.h"
#include "coordinator/integrate/foretold.h"
#include "coordinator/integrate/settings.h"

/* Tile runs that a trial has found the errors of: on rank 0. Zero: nothing was tried. */
struct kiln_tried_light {
    struct kiln_tried_tile *tiles; /* owned */
    size_t count;
};

/* Collective. Tries the light of a prepared bake; of one without an error of published light nothing. A bake on a
 * device has a BVH of the host built for it; a scene of more than 2^20 triangles is not tried. Release after a failure,
 * too. KILN_SYSTEM. */
int kiln_prepare_try(const struct kiln_prepared *prepared, const struct kiln_integrate_settings *settings,
                     struct kiln_tried_light *tried, struct kiln_error *error);
/* All rounds, the first one too; zero if nothing was tried. `most`: of their samples over those of the first; INFINITY:
 * any. `denoises`: the lightmaps are denoised. Not collective. KILN_SYSTEM. */
int kiln_prepare_foretell(const struct kiln_tried_light *tried, const struct kiln_integrate_settings *settings,
                          bool denoises, double most, struct kiln_foretold *foretold, struct kiln_error *error);
void kiln_prepare_forget(struct kiln_tried_light *tried);

#endif
