/* A step is one pass over all surface points: all ranks run the same pass of their backends over their own points, and
 * the next step begins when all are done. An integrator determines the steps (integrator.h). A step report holds the
 * results of a step. */
#ifndef KILN_COORDINATOR_INTEGRATE_STEP_H
#define KILN_COORDINATOR_INTEGRATE_STEP_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "coordinator/integrate/energy.h"
#include "coordinator/integrate/foretold.h"
#include "worker/pass/pass.h"

/* Names of one kind of step, as users see them. */
struct kiln_role {
    const char *kind;  /* of one step, in run.json: "bounce" */
    const char *total; /* of all steps of the kind, in run.json and `kiln plan`: "bounces" */
    const char *title; /* of one step, in the progress line and the timeline: "bounce" */
    const char *phase; /* of all steps of the kind, in the table of phases: "bounces" */
    bool numbered;     /* the progress line adds the number of the bounce */
    bool optional;     /* bakes without such steps omit the row in the table of phases */
};

enum { KILN_ROLES_MAX = 8 }; /* of a bake */

/* The roles of a bake's steps: kiln_roles (quantity.h). */
struct kiln_roles {
    const struct kiln_role *of[KILN_ROLES_MAX];
    uint32_t count;
};

struct kiln_quantity;

struct kiln_step {
    const struct kiln_pass *pass;         /* run by the backends, over tile runs */
    const void *parameters;               /* the pass's own struct, borrowed; NULL for a pass without */
    uint32_t role;                        /* index into the roles of the bake; the first are the integrator's */
    const struct kiln_quantity *quantity; /* quantity that the step computes (quantity.h); NULL: integrator's step */
    uint32_t bounce;  /* 0: direct light; 1, 2, ...; a final gather has the number of the bounce that it replaces */
    uint32_t samples; /* per point; with samples_field their mean, which determines the length of batches */
    /* Name of the bake's field (field/field.h) with the samples of each tile run, 32 bits each; NULL: equal for all
     * tile runs. As a field it is visible to ranks that steal work, and moves with the points. */
    const char *samples_field;
    /* bake in parts (parts.h): number of the part, and index of its first sample; else 0 */
    uint32_t part, first_sample;
    uint32_t iterations, first_iteration; /* step that lands (land.h): iterations, and index of the first; else 0 */
    uint32_t stream; /* distinguishes steps of one pass in the random numbers; 0 for a pass without streams */
    /* The step's radiosity is rounded to 4 bytes a point (worker/scene/radiosity.h); otherwise it has 8. */
    bool compact;
    bool early;    /* compact radiosity is exchanged during the step, since a step that gathers it will follow */
    bool counted;  /* in the bake's energy ledger */
    bool terminal; /* no step of the integrator gathers from its results: points may be left out */
    uint32_t with; /* optional companions of the step: KILN_WITH (companion.h) */
};

/* Load balance of the ranks after a step, and the action taken; the same on all ranks. */
struct kiln_step_balance {
    bool judged, moved;
    double imbalance; /* longest work over the mean, less 1: of a rank, or of a node whose ranks help each other */
    double gain;      /* s in the remaining steps, if the points were redistributed by their costs */
    double cost;      /* s for moving; 0: not computed */
    uint64_t points;  /* received by the rank that gets most, or would be */
};

/* A round of a bake with a target error (rounds.h): its first and last level, and the fraction of unfinished points.
 * Zero: no round. With an error of published light the fraction is of the samples that all points would have; caustics
 * have levels of their own, and with two equal ones the round has no caustics. */
struct kiln_round {
    uint32_t from, to;
    double share;
    uint32_t caustics_from, caustics_to;
};

/* Weight of the samples of a part at one tile run (parts.h). */
struct kiln_part_weight {
    double before; /* samples of all earlier parts over those of this part */
    float share;   /* of this part's samples among those of the parts with the same number so far */
};

/* Results of the pilots of a caustics step (land_trial.h): root mean squares over the area, relative to direct light;
 * for an error of published light, means. Zero: no trial. */
struct kiln_caustic_trial {
    bool tried, left_out;
    double brings, rest; /* contribution of caustics; error of the remaining light */
};

/* Results of one step. Step, energy, tail_error, caustics and balance are the same on all ranks. */
struct kiln_step_report {
    struct kiln_step step;
    uint64_t rays;                    /* of this rank, including ranks of earlier runs whose work it took over */
    double seconds, exchange_seconds; /* likewise: computing; waiting and exchanging */
    double device_seconds;            /* likewise: part of `seconds` in which the device was busy; 0 without one */
    uint64_t probe_rays;              /* likewise: of radiance probes gathered for the step; not in `rays` */
    double probe_seconds;             /* likewise; not in `seconds` */
    double judging_seconds;           /* of this rank in this run, after the last step of a round; not in `seconds` */
    /* points of this rank computed by others of its node in this run, and vice versa */
    uint64_t given, taken;
    struct kiln_step_energy energy;
    /* Error that a geometric series from this step on would make: root mean square over groups of tiles, relative to
     * the group's total reflected power; 0 where nothing depends on it. */
    double tail_error;
    /* Largest such error of an object's mean, beyond noise; 0 where nothing depends on it, for example if the tail is
     * not good enough for the whole scene. */
    double object_error;
    /* after the last step of a round (rounds.h): fraction of points in tile runs with an error above the target; for an
     * error of published light, the error reached (parts/published.h) */
    double unfinished;
    double texel_loss;                  /* likewise, as judged (parts/texel_loss.h); 0: not known. Not saved */
    struct kiln_round round;            /* the next round */
    struct kiln_foretold foretold;      /* likewise, of all rounds that follow: on rank 0. Not saved */
    bool out_of_time;                   /* the next round is omitted, since it would hardly end in time */
    struct kiln_caustic_trial caustics; /* of the first step that lands */
    struct kiln_step_balance balance;
};

/* Growing list of reports of[0 .. count). Zero: empty. Release with kiln_free(&reports.of). */
struct kiln_step_reports {
    struct kiln_step_report *of;
    size_t count, room;
};

/* Returns the results of the step that tried caustics; zero: no step did. */
static inline struct kiln_caustic_trial kiln_caustics_found(const struct kiln_step_reports *reports)
{
    size_t i = 0;
    while (i < reports->count && !reports->of[i].caustics.tried)
        i++;
    return i < reports->count ? reports->of[i].caustics : (struct kiln_caustic_trial){.tried = false};
}

/* Reserves memory for `count` reports. KILN_SYSTEM. */
int kiln_step_reports_reserve(struct kiln_step_reports *reports, size_t count, struct kiln_error *error);

#endif
