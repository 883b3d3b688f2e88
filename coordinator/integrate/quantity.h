/* A quantity is something that a bake computes of each surface point besides its light, when the user asks for it:
 * how open the place is, or from where the light comes. Each is one step, after the integrator's last, so that it may
 * read the total radiosity of all points; it is the same for every integrator. One file for each (quantity/NAME.c),
 * and the table of all is quantities.c. Its values are fields (coordinator/field/fields.c).
 *
 * The steps of a bake are the integrator's and then those of the quantities: kiln_steps_next says which comes next. */
#ifndef KILN_COORDINATOR_INTEGRATE_QUANTITY_H
#define KILN_COORDINATOR_INTEGRATE_QUANTITY_H

#include "coordinator/integrate/integrator.h"

/* The names of all quantities, in the order in which they are computed: each is a struct kiln_quantity_NAME. */
#define KILN_QUANTITY_LIST(DO) DO(occlusion) DO(directional)

struct kiln_quantity {
    struct kiln_role role;
    /* Whether a bake with these settings computes it. */
    bool (*wanted)(const struct kiln_integrate_settings *settings);
    /* Fills in pass, parameters and samples of its step. Where the pass reads radiosity, that is the total. */
    void (*make_step)(const struct kiln_integrate_settings *settings, struct kiln_step *step);
    /* Takes the answers of one tile run over into the fields of `data`: as kiln_integrator.take, without sums. */
    void (*take)(const struct kiln_taking *taking, const struct kiln_rank_data *data,
                 const struct kiln_tile_run *tile_run, const void *results);
};

#define KILN_QUANTITY_DECLARE(name) extern const struct kiln_quantity kiln_quantity_##name;
KILN_QUANTITY_LIST(KILN_QUANTITY_DECLARE)
#undef KILN_QUANTITY_DECLARE

/* The step after those reported: the integrator's, and when it has no more, those of the quantities that are wanted.
 * Pure, and the same on all ranks: see kiln_integrator.next. */
bool kiln_steps_next(const struct kiln_integrate_settings *settings, const struct kiln_step_report *reports,
                     size_t count, struct kiln_step *step);

/* The roles of a bake's steps: the integrator's, then those of the quantities that are wanted. */
struct kiln_roles kiln_roles(const struct kiln_integrate_settings *settings);

/* Whether some integrator or quantity has a role with this row in the table of phases. */
bool kiln_is_phase_of_steps(const char *phase);

#endif
