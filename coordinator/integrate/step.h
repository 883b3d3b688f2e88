/* A step is one round of a bake in which every surface point is computed once: all ranks run the same pass of their
 * backends over all own points, and the next step begins when all are done. An integrator says which steps there are
 * (integrator.h). A step report is what a step came to. */
#ifndef KILN_COORDINATOR_INTEGRATE_STEP_H
#define KILN_COORDINATOR_INTEGRATE_STEP_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "coordinator/integrate/energy.h"
#include "worker/pass/pass.h"

/* Names of one kind of steps, as users see them. */
struct kiln_role {
    const char *kind;  /* of one step, in run.json: "bounce" */
    const char *total; /* of all of them, in run.json and what `kiln plan` says: "bounces" */
    const char *title; /* of one step, in the progress line and the timeline: "bounce" */
    const char *phase; /* of all of them, in the table of phases: "bounces" */
    bool numbered;     /* the progress line adds the number of the bounce */
    bool optional;     /* bakes without such steps have no row of it */
};

enum { KILN_ROLES_MAX = 8 }; /* of a bake */

/* The roles of a bake's steps: kiln_roles (quantity.h). */
struct kiln_roles {
    const struct kiln_role *of[KILN_ROLES_MAX];
    uint32_t count;
};

struct kiln_quantity;

struct kiln_step {
    const struct kiln_pass *pass;         /* which the backends run; over tile runs */
    const void *parameters;               /* the pass's own struct, borrowed; NULL for a pass without */
    uint32_t role;                        /* index into the roles of the bake; the first are the integrator's */
    const struct kiln_quantity *quantity; /* that the step computes (quantity.h); NULL: it is the integrator's */
    uint32_t bounce;  /* 0: direct light; 1, 2, ...; a final gather has the number of the bounce that it stands for */
    uint32_t samples; /* of each point; with samples_field their mean, by which the length of batches is chosen */
    /* Name of the bake's field (field/field.h) that has the samples of each tile run, 32 bits each; NULL: all tile runs
     * have the same. Being a field, it lies where a rank that steals work sees it, and moves with the points. */
    const char *samples_field;
    /* of a bake in parts (parts.h): which part the step is of, and the number of the first of its samples; else 0 */
    uint32_t part, first_sample;
    uint32_t iterations, first_iteration; /* of light paths, of a step that lands (land.h), likewise; else 0 */
    uint32_t stream; /* tells steps of one pass apart in the random numbers; 0 for a pass without streams */
    /* The radiosity that the step makes is rounded to 4 bytes a point (worker/scene/radiosity.h); else it has 8. */
    bool compact;
    bool early;    /* and travels while the step goes on, for a step that gathers from it will follow */
    bool counted;  /* in the bake's energy ledger */
    bool terminal; /* no step of the integrator gathers from what it makes: points may be left out */
    uint32_t with; /* which companions accompany it, of those that not all steps have: KILN_WITH (companion.h) */
};

/* Balance of the ranks after a step, and action taken; the same on all ranks. */
struct kiln_step_balance {
    bool judged, moved;
    double imbalance; /* longest work over the mean, less 1: of a rank, or of a node whose ranks help each other */
    double gain;      /* s in the steps to come, if the points were distributed anew by what they cost */
    double cost;      /* s for moving; 0: not asked */
    uint64_t points;  /* that the rank that gets most gets, or would */
};

/* A round of a bake with a target error (rounds.h): the levels that it goes from and to, and the share of the points
 * that are not finished. Zero: there is none. */
struct kiln_round {
    uint32_t from, to;
    double share;
};

/* Findings of the pilots of a step of caustics (land_trial.h): root mean squares over the area, relative to direct
 * light. Zero: nothing was tried. */
struct kiln_caustic_trial {
    bool tried, left_out;
    double brings, rest; /* what caustics bring; the error of the rest */
};

/* One step, as it went. Step, energy, tail_error, caustics and balance are the same on all ranks. */
struct kiln_step_report {
    struct kiln_step step;
    uint64_t rays;                    /* of this rank, and of earlier runs' ranks whose work it took over */
    double seconds, exchange_seconds; /* likewise: computing; waiting and exchanging */
    double device_seconds;            /* likewise: of `seconds`, what the device was busy; 0 without one */
    uint64_t probe_rays;              /* likewise: of the radiance probes that were gathered for it; not in `rays` */
    double probe_seconds;             /* likewise; not in `seconds` */
    /* points of this rank that others of its node computed in this run, and the other way round */
    uint64_t given, taken;
    struct kiln_step_energy energy;
    /* Root mean square over groups of tiles of the error that a geometric series from this step on would make, relative
     * to what the group reflects in all; 0 where nothing depends on it. */
    double tail_error;
    /* The largest of such errors of an object's mean, beyond chance; 0 where nothing depends on it, as where the tail
     * is not good enough for the scene as a whole. */
    double object_error;
    /* after the last step of a round (rounds.h): share of the points that lie where the error is above the target */
    double unfinished;
    struct kiln_round round;            /* and the round that comes next */
    bool out_of_time;                   /* and whether that would hardly end in time, and so does not come */
    struct kiln_caustic_trial caustics; /* of a step that lands, if it is the first */
    struct kiln_step_balance balance;
};

/* A list of reports that grows; of[0 .. count) are there. Zero: empty. Release with kiln_free(&reports.of). */
struct kiln_step_reports {
    struct kiln_step_report *of;
    size_t count, room;
};

/* Returns the findings of the one step that tries caustics; zero: nothing was tried. */
static inline struct kiln_caustic_trial kiln_caustics_found(const struct kiln_step_reports *reports)
{
    size_t i = 0;
    while (i < reports->count && !reports->of[i].caustics.tried)
        i++;
    return i < reports->count ? reports->of[i].caustics : (struct kiln_caustic_trial){.tried = false};
}

/* Room for `count` reports. KILN_SYSTEM. */
int kiln_step_reports_reserve(struct kiln_step_reports *reports, size_t count, struct kiln_error *error);

#endif
