/* States that the files of the runner of states (states.h) share. */
#ifndef KILN_COORDINATOR_INTEGRATE_RELIGHT_STATES_PRIVATE_H
#define KILN_COORDINATOR_INTEGRATE_RELIGHT_STATES_PRIVATE_H

#include "coordinator/integrate/run/batches.h"
#include "coordinator/integrate/run/radiosity_exchange.h"
#include "coordinator/integrate/relight/states.h"

/* One state: a solution of its own, and what takes its answers. */
struct kiln_state_slot {
    struct kiln_integrate_params params;
    struct kiln_solution *solution;
    struct kiln_ledger ledger;
    struct kiln_taker taker;
    struct kiln_radiosity_exchange exchange;
    struct kiln_integration integration;
    struct kiln_state state;
    struct kiln_step step;             /* the next */
    bool goes_on;                      /* there is one, and it waits for no other state */
    bool has_next;                     /* there is one */
    bool mixed;                        /* a device has mixed its direct light */
    bool stale;                        /* fields are those of the state before */
    struct kiln_point_result *results; /* of AT_ONCE tile runs */
};

struct kiln_states {
    const struct kiln_integrate_params *params;
    struct kiln_resident *resident;
    struct kiln_state_slot *slots;
    size_t width, active;
    bool may_hold;             /* light may stay on a device */
    bool holds;                /* it does: that of all active states, which no host has */
    struct kiln_held_step how; /* of the step under way; what it has added up: */
    struct kiln_held_power powers[KILN_STATES_MOST][KILN_HELD_POWERS];
    float *light;    /* of the states that gather together: resident_rows.h */
    uint8_t *wanted; /* of each own tile run: a state asks for it */
};

/* Whether the next step is direct light that a device may mix. */
bool kiln_state_mixes(const struct kiln_state_slot *slot);
/* The fields of results and steps become zero, but for those that hang on no light; `but`: pointers to fields that are
 * written as a whole now, ended by NULL. Nothing where that was done since the state began. */
void kiln_state_clear_fields(struct kiln_state_slot *slot, const void *const *but);

/* ---- light that stays on a device (worker/pass/held.h): states_held.c ---- */

/* Begins the next step of all active states where a device does it with light that it holds, or will from now on.
 * False: the host does it. */
int kiln_states_hold(struct kiln_states *states, bool *held, struct kiln_error *error);
/* The step that was begun. After the last of its kind the host has the light again. KILN_NO_DEVICE: what the device
 * held is lost. */
int kiln_states_run_held(struct kiln_states *states, struct kiln_error *error);

#endif
