/* The runner of states solves one surface under several lights, colours and skies at once, from kept transport in
 * memory (resident.h). Like the lockstep runner, it asks the integrator for steps and passes it answers, state by
 * state. But all states in the same step share one read of its rays, and direct light may come from the caller. Each
 * state has the same bits as when it is solved alone, for any ranks and threads.
 *
 * The runner saves nothing and moves no points between ranks. */
#ifndef KILN_COORDINATOR_INTEGRATE_RELIGHT_STATES_H
#define KILN_COORDINATOR_INTEGRATE_RELIGHT_STATES_H

#include "coordinator/integrate/integrate.h"
#include "coordinator/integrate/relight/resident.h"
#include "coordinator/integrate/run/take.h"

/* Callbacks that supply or observe the answers of direct steps. Not collective. */
struct kiln_state_direct {
    kiln_give_results give; /* NULL: the backend traces them */
    /* called with the answers that were traced; may be NULL */
    void (*see)(void *context, const struct kiln_step *step, size_t first, size_t count,
                const struct kiln_point_result *results);
    /* called with the own data after a step was traced and taken; may be NULL */
    void (*end)(void *context, const struct kiln_rank_data *own);
    void *context;
    /* `give` returns the scaled sum of these parts (worker/pass/held.h), so a device may compute it */
    bool mixed;
    const struct kiln_held_term *parts;
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

/* Collective. Allocates `width` states to solve at once. Borrows the parameters; each state replaces their settings and
 * emission. KILN_SYSTEM. Destroy, collectively, with kiln_states_destroy. */
int kiln_states_create(struct kiln_states **states, const struct kiln_integrate_params *params,
                       struct kiln_resident *resident, size_t width, struct kiln_error *error);
void kiln_states_destroy(struct kiln_states **states);

/* Collective. Solves up to `width` states, overwriting those solved before. The status is the same on all ranks. */
int kiln_states_solve(struct kiln_states *states, const struct kiln_state *of, size_t count, struct kiln_error *error);
/* Returns the light of a solved state; valid until the next call of kiln_states_solve. */
struct kiln_solution *kiln_states_solution(const struct kiln_states *states, size_t state);

#endif
