/* Private structures shared by the files of the runner of states (states.h). */
#ifndef KILN_COORDINATOR_INTEGRATE_RELIGHT_STATES_PRIVATE_H
#define KILN_COORDINATOR_INTEGRATE_RELIGHT_STATES_PRIVATE_H

#include "coordinator/integrate/run/batches.h"
#include "coordinator/integrate/run/radiosity_exchange.h"
#include "coordinator/integrate/relight/states.h"

/* One state: its own solution, and the objects that process its answers. */
struct kiln_state_slot {
    struct kiln_integrate_params params;
    struct kiln_solution *solution;
    struct kiln_ledger ledger;
    struct kiln_taker taker;
    struct kiln_radiosity_exchange exchange;
    struct kiln_integration integration;
    struct kiln_state state;
    struct kiln_step step;             /* the next */
    bool goes_on;                      /* there is a next step, and it waits for no other state */
    bool has_next;                     /* there is one */
    bool mixed;                        /* a device has mixed its direct light */
    bool stale;                        /* fields still hold the previous state */
    struct kiln_point_result *results; /* of AT_ONCE tile runs */
};

struct kiln_states {
    const struct kiln_integrate_params *params;
    struct kiln_resident *resident;
    struct kiln_state_slot *slots;
    size_t width, active;
    bool may_hold;             /* light may stay on a device */
    bool holds;                /* light stays on a device, for all active states; no host has it */
    struct kiln_held_step how; /* the current step; its power sums: */
    struct kiln_held_power powers[KILN_STATES_MOST][KILN_HELD_POWERS];
    float *light;    /* of states that gather together: resident_rows.h */
    uint8_t *wanted; /* for each own tile run: some state requests it */
};

/* Whether the next step is direct light that a device may compute as a mixture of parts. */
bool kiln_state_mixes(const struct kiln_state_slot *slot);
/* Zeroes the fields of results and steps, except those that do not depend on light. `but`: pointers to fields that are
 * about to be overwritten as a whole, ended by NULL. Does nothing if done since the state began. */
void kiln_state_clear_fields(struct kiln_state_slot *slot, const void *const *but);

/* ---- light that stays on a device (worker/pass/held.h): states_held.c ---- */

/* Begins the next step of all active states on a device that holds their light, or will from now on. *held is false:
 * the host computes the step. */
int kiln_states_hold(struct kiln_states *states, bool *held, struct kiln_error *error);
/* Runs the step that was begun. After the last such step the host has the light again. KILN_NO_DEVICE: the light on the
 * device is lost. */
int kiln_states_run_held(struct kiln_states *states, struct kiln_error *error);

#endif
