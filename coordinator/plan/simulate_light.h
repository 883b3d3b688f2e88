/* Light transport of a simulated bake: what the ranks work in each step, which of them help each other, when the points
 * are distributed anew.
 *
 * Cells stand in a row, in the global order, and within each one points cost the same; a rank has a stretch of that
 * row. The first ones are those of the partition. The ranks of a node that help each other end together, half
 * of a smallest batch after the mean of their work; others end when the slowest does. After a step the rule of bakes
 * (integrate/run/repartition_rule.h) is asked, with what the simulated step cost. */
#ifndef KILN_COORDINATOR_PLAN_SIMULATE_LIGHT_H
#define KILN_COORDINATOR_PLAN_SIMULATE_LIGHT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "coordinator/plan/steps.h"
#include "worker/base/status.h"

struct kiln_light_simulation {
    const struct kiln_integrate_settings *settings; /* of the bake: work stealing, repartition, faults */
    const struct kiln_planned_steps *steps;
    uint32_t ranks_per_node;      /* 0: one */
    uint32_t shared_memory_ranks; /* at most so many of a node help each other; 0: all */
    const uint64_t *cell_points;  /* of the occupied cells */
    /* seconds a point of each, in a step of each kind, of a rank with all the cores (or the GPU) that it gets */
    const double *cell_cost[KILN_COST_KINDS_MAX];
    size_t cell_count;
    uint64_t tile_runs;        /* smallest units of work */
    uint32_t threads;          /* of a rank */
    bool computes_for_others;  /* its backend computes points of other ranks, */
    bool keeps_points;         /* and keeps its own: both as kiln_backend_info says */
    uint64_t part_points;      /* it knows what so many points cost together, no less; 0: exactly */
    double moved_bytes;        /* of a point, when it moves */
    double bandwidth, latency; /* of a node: bytes a second, seconds */
};

struct kiln_simulated_light {
    double seconds[KILN_ROLES_MAX]; /* until the last rank is done: all steps of each role */
    double trial;                   /* s of it, in the role of the first step: what points cost is tried (trial.h) */
    double move;                    /* s that points are on their way to other ranks */
    double imbalance;               /* these seconds (without moves) over the mean of the ranks' work, less 1 */
    double kept;                    /* likewise if the ranks kept their first points and no rank helped another */
    double points_most;             /* that a rank has at any time */
    uint32_t repartitions;          /* how often the points were distributed anew */
    /* longest work over the mean, less 1, as a bake judges it (kiln_step_balance): in the first and the last step of
     * each role */
    double first[KILN_ROLES_MAX], last[KILN_ROLES_MAX];
};

/* The bake with `density` points for each one of the cells' on `ranks` ranks. KILN_SYSTEM. */
int kiln_simulate_light(const struct kiln_light_simulation *simulation, uint32_t ranks, double density,
                        struct kiln_simulated_light *light, struct kiln_error *error);

#endif
