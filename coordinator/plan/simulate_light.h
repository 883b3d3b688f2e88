/* Light transport of a simulated bake: the work of the ranks in each step, work stealing between them, and
 * repartitioning of the points.
 *
 * Model: cells are in a sequence, the global order. All points of a cell cost the same. A rank has a contiguous range
 * of the sequence, at first that of the partition. Ranks of a node that steal work from each other end together, half a
 * smallest batch after the mean of their work. Without stealing, a step ends with the slowest rank. After each step the
 * rule of real bakes (integrate/run/repartition_rule.h) decides on repartitioning, from the costs of the simulated
 * step. */
#ifndef KILN_COORDINATOR_PLAN_SIMULATE_LIGHT_H
#define KILN_COORDINATOR_PLAN_SIMULATE_LIGHT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "coordinator/bake/reckon/steps.h"
#include "worker/base/status.h"

struct kiln_light_simulation {
    const struct kiln_integrate_settings *settings; /* of the bake: work stealing, repartition, faults */
    const struct kiln_planned_steps *steps;
    uint32_t ranks_per_node;      /* 0: one */
    uint32_t shared_memory_ranks; /* largest number of ranks of a node that steal work from each other; 0: all */
    const uint64_t *cell_points;  /* points of each occupied cell */
    /* seconds per point in each cell, for each kind of step, on a rank with all its cores (or its GPU) */
    const double *cell_cost[KILN_COST_KINDS_MAX];
    size_t cell_count;
    uint64_t tile_runs;        /* smallest units of work */
    uint32_t threads;          /* of a rank */
    bool computes_for_others;  /* the backend can compute points of other ranks (kiln_backend_info) */
    bool keeps_points;         /* the backend keeps the rank's own points (kiln_backend_info) */
    uint64_t part_points;      /* costs are known only for groups of this many points; 0: for each point */
    double moved_bytes;        /* bytes of a point sent to another rank */
    double bandwidth, latency; /* of a node: bytes per second, seconds */
};

struct kiln_simulated_light {
    double seconds[KILN_ROLES_MAX]; /* until the last rank is done: all steps of each role */
    double trial;                   /* part of these, in the first step's role: the trial of point costs (trial.h) */
    double move;                    /* s in which points are sent to other ranks */
    double imbalance;               /* `seconds` of all roles (without moves) / mean work of the ranks - 1 */
    double kept;                    /* the same imbalance, without repartitioning and work stealing */
    double points_most;             /* largest number of points of a rank at any time */
    uint32_t repartitions;          /* number of repartitions */
    /* longest work / mean work - 1, as a bake judges it (kiln_step_balance): in the first and the last step of each
     * role */
    double first[KILN_ROLES_MAX], last[KILN_ROLES_MAX];
};

/* Simulates the light transport on `ranks` ranks, with `density` times the points of the cells. KILN_SYSTEM. */
int kiln_simulate_light(const struct kiln_light_simulation *simulation, uint32_t ranks, double density,
                        struct kiln_simulated_light *light, struct kiln_error *error);

#endif
