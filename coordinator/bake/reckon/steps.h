/* Steps of a planned bake, classified by their cost. */
#ifndef KILN_COORDINATOR_BAKE_RECKON_STEPS_H
#define KILN_COORDINATOR_BAKE_RECKON_STEPS_H

#include "coordinator/integrate/quantity.h"

/* Cost kind: steps that run the same pass with the same parameters and samples, and so cost the same. */
struct kiln_cost_kind {
    const struct kiln_pass *pass;
    const void *parameters;   /* of the pass */
    uint32_t samples, stream; /* stream: of the first such step */
    uint32_t with;            /* companions of the step (integrate/companion.h) */
    bool answered;            /* a companion gives the result of the step: the pass is not run */
};

enum { KILN_COST_KINDS_MAX = 12 };

struct kiln_planned_step {
    struct kiln_step step;
    uint32_t kind;               /* index into the kinds of cost */
    struct kiln_outlook outlook; /* from this step on, as the bake itself will compute it there */
};

/* Release with kiln_planned_steps_release. */
struct kiln_planned_steps {
    struct kiln_roles roles;
    struct kiln_planned_step *of;
    size_t count, room;
    struct kiln_cost_kind kinds[KILN_COST_KINDS_MAX];
    uint32_t kind_count;
};

/* Makes the list of steps. If the settings do not fix the number of bounces, plans `typical` bounces. KILN_SYSTEM. */
int kiln_planned_steps_make(struct kiln_planned_steps *steps, const struct kiln_integrate_settings *settings,
                            uint32_t typical, struct kiln_error *error);
void kiln_planned_steps_release(struct kiln_planned_steps *steps);

#endif
