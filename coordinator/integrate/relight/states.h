/* The runner of states: the light of one surface under several lights, colours and skies at once, from kept transport
 * in memory (resident.h). It asks the integrator for steps and hands it answers as the lockstep runner does, state by
 * state; but the gathers of all states that take the same step share one read of its rays, and direct light is given by
 * who knows it. Each state has the bits that it has alone, and all ranks and numbers of threads give the same.
 *
 * Nothing is saved, and no points move between ranks. */
#ifndef KILN_COORDINATOR_INTEGRATE_RELIGHT_STATES_H
#define KILN_COORDINATOR_INTEGRATE_RELIGHT_STATES_H

#include "coordinator/integrate/integrate.h"
#include "coordinator/integrate/relight/resident.h"
#include "coordinator/integrate/run/take.h"

/* Source or receiver of the answers of direct steps. Not collective. */
struct kiln_state_direct {
    kiln_give_results give; /* NULL: the backend traces them */
    /* Sees the answers that were traced; NULL: nobody does. */
    void (*see)(void *context, const struct kiln_step *step, size_t first, size_t count,
                const struct kiln_point_result *results);
    /* Sees the own data when a step was traced and taken; NULL: nobody does. */
    void (*end)(void *context, const struct kiln_rank_data *own);
    void *context;
    /* what `give` gives is the sum of these, scaled (worker/pass/held.h): a device may do it */
    bool mixed;
    const struct kiln_held_part *parts;
    uint32_t part_count;
};

/* A state. All borrowed. */
struct kiln_state {
    const struct kiln_integrate_settings *settings;
    const struct kiln_emission_result *emission;
    const uint16_t *albedo; /* of the own points: as kiln_surface.albedo */
    struct kiln_state_direct direct;
};

enum { KILN_STATES_MOST = 16 }; /* at once */

struct kiln_states;

/* Collective. Room for `width` states at once. Borrows the parameters; of these, settings and emission are those of
 * each state. KILN_SYSTEM. Destroy, collectively, with kiln_states_destroy. */
int kiln_states_create(struct kiln_states **states, const struct kiln_integrate_params *params,
                       struct kiln_resident *resident, size_t width, struct kiln_error *error);
void kiln_states_destroy(struct kiln_states **states);

/* Collective. Solves up to `width` states. What was solved before is lost. The status is the same on all ranks. */
int kiln_states_solve(struct kiln_states *states, const struct kiln_state *of, size_t count, struct kiln_error *error);
/* The light of a state that was solved; it changes with the next call. */
struct kiln_solution *kiln_states_solution(const struct kiln_states *states, size_t state);

#endif
