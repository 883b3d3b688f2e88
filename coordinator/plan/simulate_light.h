/* Light transport of a simulated bake: what the ranks work in each pass, which of them help each other, when shares are
 * cut anew.
 *
 * Cells stand in a row, in the global order, and within each one points cost the same; shares are stretches of that
 * row. The first ones are cut as the partition cuts them. The ranks of a node that help each other end together, half
 * of a smallest batch after the mean of their work; others end when the slowest does. After a pass the rule of bakes
 * (recut.h) is asked, with what the simulated pass cost. */
#ifndef KILN_COORDINATOR_PLAN_SIMULATE_LIGHT_H
#define KILN_COORDINATOR_PLAN_SIMULATE_LIGHT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "coordinator/job/job.h"
#include "worker/base/status.h"

enum { KILN_LIGHT_DIRECT, KILN_LIGHT_BOUNCE, KILN_LIGHT_FINAL, KILN_LIGHTS };

struct kiln_light_simulation {
    /* schedule, samples, --give-away, --rebalance, --share-ranks, ranks of a node */
    const struct kiln_job *job;
    const uint64_t *cell_points; /* of the occupied cells */
    /* seconds a point of each, in a pass, of a rank with all the cores (or the GPU) that it gets */
    const double *cell_cost[KILN_LIGHTS];
    size_t cell_count;
    uint64_t tile_runs;        /* smallest units of work */
    uint32_t bounces;          /* gathers, the final one among them */
    uint32_t threads;          /* of a rank */
    bool any_share;            /* its backend computes any rank's share */
    uint64_t part_points;      /* it knows what so many points cost together, no less; 0: exactly */
    double share_bytes;        /* of a point, when it moves */
    double bandwidth, latency; /* of a node: bytes a second, seconds */
    uint32_t slow_rank;        /* for tests: takes `slowness` (1 or more) times as long as others */
    double slowness;
};

struct kiln_simulated_light {
    double seconds[KILN_LIGHTS]; /* until the last rank is done: direct light, all bounces, the final gather */
    double move;                 /* s that points are on their way to other ranks */
    double imbalance;            /* these seconds (without moves) over the mean of the ranks' work, less 1 */
    double kept;                 /* likewise if the first shares stayed and no rank helped another */
    double points_most;          /* that a rank has at any time */
    uint32_t cuts;               /* how often shares were cut anew */
    /* longest work over the mean, less 1, as a bake judges it (kiln_pass_balance): in the first and the last pass of
     * each kind */
    double first[KILN_LIGHTS], last[KILN_LIGHTS];
};

/* The bake with `density` points for each one of the cells' on `ranks` ranks. KILN_SYSTEM. */
int kiln_simulate_light(const struct kiln_light_simulation *simulation, uint32_t ranks, double density,
                        struct kiln_simulated_light *light, struct kiln_error *error);

#endif
