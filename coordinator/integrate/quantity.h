/* Quantities: values besides light that a bake computes for each surface point on request, such as openness of the
 * place or direction of the light. Each is one step after the integrator's last, so it may read the total radiosity of
 * all points; it is the same for every integrator. Each has one file (quantity/NAME.c), and quantities.c has the table
 * of all. Its values are fields (coordinator/field/fields.c).
 *
 * The steps of a bake are first the integrator's, then those of the quantities; kiln_steps_next gives the next one. */
#ifndef KILN_COORDINATOR_INTEGRATE_QUANTITY_H
#define KILN_COORDINATOR_INTEGRATE_QUANTITY_H

#include "coordinator/integrate/integrator.h"

/* The names of all quantities, in the order in which they are computed: each is a struct kiln_quantity_NAME. */
#define KILN_QUANTITY_LIST(DO) DO(occlusion) DO(directional)

struct kiln_quantity {
    struct kiln_role role;
    /* Whether a bake with these settings computes the quantity. */
    bool (*wanted)(const struct kiln_integrate_settings *settings);
    /* Fills in pass, parameters and samples of the quantity's step. A pass that reads radiosity gets the total. */
    void (*make_step)(const struct kiln_integrate_settings *settings, struct kiln_step *step);
    /* Stores the answers of one tile run in the fields of `data`: as kiln_integrator.take, without sums. */
    void (*take)(const struct kiln_taking *taking, const struct kiln_rank_data *data,
                 const struct kiln_tile_run *tile_run, const void *results);
};

#define KILN_QUANTITY_DECLARE(name) extern const struct kiln_quantity kiln_quantity_##name;
KILN_QUANTITY_LIST(KILN_QUANTITY_DECLARE)
#undef KILN_QUANTITY_DECLARE

/* Finds the step after those reported: the integrator's next, or after its last one those of the wanted quantities.
 * Pure, and the same on all ranks: see kiln_integrator.next. */
bool kiln_steps_next(const struct kiln_integrate_settings *settings, const struct kiln_step_report *reports,
                     size_t count, struct kiln_step *step);

/* The roles of a bake's steps: the integrator's, then those of the quantities that are wanted. */
struct kiln_roles kiln_roles(const struct kiln_integrate_settings *settings);

/* Whether some integrator or quantity has a role with this row in the table of phases. */
bool kiln_is_phase_of_steps(const char *phase);

#endif
