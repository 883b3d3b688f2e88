/* An integrator is a way to compute the light of a scene: which steps there are, what is done with the answers of each,
 * and what is exchanged between them. One struct of functions for each; the table of all is integrators.c, one folder
 * for each holds its code.
 *
 * The lockstep runner (lockstep.h) asks `next` for a step, calls `begin_step`, has all own points computed, in batches
 * whose answers `take` gets, calls `end_step`, and asks again. `kiln plan`, its simulation and the rule that
 * distributes points anew ask the same `next` for the steps to come. */
#ifndef KILN_COORDINATOR_INTEGRATE_INTEGRATOR_H
#define KILN_COORDINATOR_INTEGRATE_INTEGRATOR_H

#include "coordinator/integrate/ledger.h"
#include "coordinator/integrate/settings.h"
#include "coordinator/integrate/solution.h"
#include "coordinator/integrate/step.h"
#include "worker/pass/held.h"

struct kiln_company;
struct kiln_radiosity_exchange;

/* Context for taking the answers of a step: read by all threads, changed by none. Borrowed. */
struct kiln_taking {
    const struct kiln_integrate_settings *settings;
    const struct kiln_step *step;
    const struct kiln_field_set *fields; /* that the data has */
    const struct kiln_scene *scene;
    const uint64_t *radiosity; /* of all points, packed: what the step gathers from */
    double scale;              /* of the 4-byte form of radiosity */
    double unit;               /* W, of the exact sums */
    uint32_t rounding;         /* added to the step's stream for the random bits that radiosity is rounded by */
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
    uint32_t role_count; /* with the quantities KILN_ROLES_MAX at most */

    /* The step after those reported; false: there is none. A pure function, the same on all ranks: it reads what the
     * settings say of steps and what the reports say that is the same on all ranks (steps, energy, tail_error). After
     * reports without energies, as `kiln plan` has them, it answers as long as the number of bounces is given. */
    bool (*next)(const struct kiln_integrate_settings *settings, const struct kiln_step_report *reports, size_t count,
                 struct kiln_step *step);
    /* Collective. Makes what `step` gathers from, of what the steps before have left, and exchanges it. Called for
     * every step but one that is gone on with from a checkpoint. `last`: the report of the step before; NULL: none. */
    int (*begin_step)(struct kiln_integration *integration, struct kiln_step_report *last, const struct kiln_step *step,
                      struct kiln_error *error);
    /* Takes the answers of one tile run over into `data`, the data of the rank that owns it (this one or another of its
     * node), and adds to the tallies. `results` is an array of the result struct of the
     * step's pass, one for each point of the tile run. Called by several threads
     * at once, for different tile runs. Of light besides that of the scene, which a
     * companion keeps, both tallies are NULL, and `data` has that light. */
    void (*take)(const struct kiln_taking *taking, const struct kiln_rank_data *data,
                 const struct kiln_tile_run *tile_run, const void *results, struct kiln_tally *tally,
                 struct kiln_tile_run_tally *tile_run_tally);
    /* Collective. All ranks are done with the last step of `reports`, whose energies are added up: fills in what `next`
     * will want to know besides. */
    int (*end_step)(struct kiln_integration *integration, struct kiln_step_reports *reports, struct kiln_error *error);
    /* Begins a step in the place of begin_step where a device may do it with light that it holds (worker/pass/held.h),
     * and says how; false: it may not, and nothing has changed. NULL: it never may. */
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

/* Assumed bounces beyond those done, where their number is not given and steps are counted before they are run. */
enum { KILN_BOUNCES_TO_COME = 3 };

/* Steps after reports[0 .. count), of which the last may be only begun. */
struct kiln_outlook {
    size_t steps;
    double samples; /* of a point */
};

/* The steps from `next` on, `next` among them. Uses the reports' room beyond their count. KILN_SYSTEM. */
int kiln_integrate_outlook(const struct kiln_integrate_settings *settings, struct kiln_step_reports *reports,
                           const struct kiln_step *next, struct kiln_outlook *outlook, struct kiln_error *error);

#endif
