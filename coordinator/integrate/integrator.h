/* An integrator is a method to compute the light of a scene: its steps, the processing of the results of each step, and
 * the data exchanged between steps. Each is one struct of functions; the table of all is integrators.c, and one folder
 * for each holds its code.
 *
 * The lockstep runner (lockstep.h) asks `next` for a step and calls `begin_step`. It has all own points computed in
 * batches, whose results go to `take`, calls `end_step`, and asks again. `kiln plan`, its simulation and the
 * redistribution of points call the same `next` to predict the coming steps. */
#ifndef KILN_COORDINATOR_INTEGRATE_INTEGRATOR_H
#define KILN_COORDINATOR_INTEGRATE_INTEGRATOR_H

#include "coordinator/integrate/ledger.h"
#include "coordinator/integrate/settings.h"
#include "coordinator/integrate/solution.h"
#include "coordinator/integrate/step.h"
#include "worker/pass/held.h"

struct kiln_company;
struct kiln_radiosity_exchange;

/* Context for storing the results of a step: read by all threads, changed by none. Borrowed. */
struct kiln_taking {
    const struct kiln_integrate_settings *settings;
    const struct kiln_step *step;
    const struct kiln_field_set *fields; /* that the data has */
    const struct kiln_scene *scene;
    const uint64_t *radiosity;      /* packed radiosity of all points, from which the step gathers */
    double scale;                   /* of the 4-byte form of radiosity */
    double unit;                    /* W, of the exact sums */
    struct kiln_part_weight weight; /* in a bake in parts: of a tile run (kiln_part_weigh) */
    uint32_t rounding;              /* added to the step's stream for the random bits that round radiosity */
};

/* Context of an integrator's collective functions. Borrowed. */
struct kiln_integration {
    MPI_Comm communicator;
    const struct kiln_integrate_settings *settings;
    struct kiln_solution *solution;
    struct kiln_ledger *ledger;
    struct kiln_radiosity_exchange *exchange;
    struct kiln_company *company; /* the bake's companions (company.h); NULL: it has none */
};

struct kiln_integrator {
    const char *name; /* for --method */
    const struct kiln_role *roles;
    uint32_t role_count; /* together with the quantities at most KILN_ROLES_MAX */

    /* Determines the step after the reported ones; false: there is none. A pure function with the same result on all
     * ranks: it reads only the settings about steps, and report values that are the same on all ranks (steps, energy,
     * tail_error). Reports without energies, as in `kiln plan`, suffice if the number of bounces is given. */
    bool (*next)(const struct kiln_integrate_settings *settings, const struct kiln_step_report *reports, size_t count,
                 struct kiln_step *step);
    /* Collective. Makes the data from which `step` gathers, from the results of earlier steps, and exchanges them.
     * Called for every step except one that is resumed from a checkpoint. `last`: the report of the step before; NULL:
     * none. */
    int (*begin_step)(struct kiln_integration *integration, struct kiln_step_report *last, const struct kiln_step *step,
                      struct kiln_error *error);
    /* Stores the results of one tile run in `data`, the data of the rank that owns it (this one or another of its
     * node), and adds to the tallies. `results` is an array of the result struct of the step's pass, one for each point
     * of the tile run. Called by several threads at once, for different tile runs. For the separate lights that a
     * companion keeps, both tallies are NULL, and `data` refers to that light. */
    void (*take)(const struct kiln_taking *taking, const struct kiln_rank_data *data,
                 const struct kiln_tile_run *tile_run, const void *results, struct kiln_tally *tally,
                 struct kiln_tile_run_tally *tile_run_tally);
    /* Collective. Called when all ranks are done with the last step of `reports`, whose energies are added up. Fills in
     * the other values that `next` needs. */
    int (*end_step)(struct kiln_integration *integration, struct kiln_step_reports *reports, struct kiln_error *error);
    /* Replaces begin_step if a device may begin the step with light that it holds (worker/pass/held.h), and says how in
     * `how`. Returns false if it may not; nothing has changed then. NULL: it never may. */
    bool (*hold)(struct kiln_integration *integration, const struct kiln_step *step, struct kiln_held_step *how);
    /* Changes what the energy ledger is closed with, where its steps find other light than the settings say. NULL: they
     * do not. */
    void (*close)(const struct kiln_integrate_settings *settings, struct kiln_energy_closing *closing);
};

/* The names of all integrators (KILN_METHOD_LIST), ended by NULL. */
extern const char *const kiln_integrator_names[];

/* NULL: there is none of that name. */
const struct kiln_integrator *kiln_integrator_find(const char *name);
/* Whether an integrator has a role with this row in the table of phases. */
bool kiln_integrator_has_phase(const char *phase);

/* Assumed number of further bounces, if it is not given and steps are counted before they run. */
enum { KILN_BOUNCES_TO_COME = 3 };

/* Forecast of the steps after reports[0 .. count); the last of these reports may be only begun. */
struct kiln_outlook {
    size_t steps;
    double samples; /* of a point */
};

/* Predicts the steps from `next` on, including `next`. Uses spare entries of the reports beyond their count.
 * KILN_SYSTEM. */
int kiln_integrate_outlook(const struct kiln_integrate_settings *settings, struct kiln_step_reports *reports,
                           const struct kiln_step *next, struct kiln_outlook *outlook, struct kiln_error *error);

#endif
