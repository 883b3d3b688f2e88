/* Progress of the current step: the own tile runs that are still to be computed, and work taken by other ranks. The
 * remaining ranges are put one by one on the rank's work queue (mpi/work_queue.h), from which other ranks of the node
 * may steal. */
#ifndef KILN_COORDINATOR_INTEGRATE_RUN_STEP_WORK_H
#define KILN_COORDINATOR_INTEGRATE_RUN_STEP_WORK_H

#include "coordinator/field/rank_data.h"

/* Zero: nothing to do. Release with kiln_step_work_release. */
struct kiln_step_work {
    /* todo[todo_first .. todo_count): remaining ranges, in order; the rest of the first one is on the queue */
    struct kiln_range *todo;
    size_t todo_first, todo_count, todo_room;
    uint64_t points_done; /* own points computed by this rank or earlier runs, without those returned by others */
    size_t sent;          /* own tile runs before this one are done, as far as known */
    /* some range before the current one has gaps: other ranks have not returned the work that they took */
    bool has_gaps;
    bool measured; /* the costs of all own tile runs were measured in this step */
};

/* Marks all own tile runs as to be computed. KILN_SYSTEM. */
int kiln_step_work_begin(struct kiln_step_work *work, size_t tile_runs, struct kiln_error *error);
/* Puts the first remaining range on the own queue. */
void kiln_step_work_offer(struct kiln_step_work *work, const struct kiln_rank_data *own);
/* Adds the own tile runs [first, end), which come after all that were added before. KILN_SYSTEM. */
int kiln_step_work_add(struct kiln_step_work *work, size_t first, size_t end, struct kiln_error *error);
/* Collective on the node, of whose ranks this process sees `node_ranks`. Waits until other ranks hold none of the own
 * work, then updates `todo`: all other tile runs are done. */
void kiln_step_work_settle(struct kiln_step_work *work, const struct kiln_rank_data *own, struct kiln_node_memory *node,
                           int node_ranks);
/* Whether any own work remains on the queue; moves to the next range when the current one is used up. */
bool kiln_step_work_any(struct kiln_step_work *work, const struct kiln_rank_data *own);
/* Marks all own tile runs before `end` as done, except those that other ranks hold. Returns the number of own points
 * done without a gap from the first one, as far as known. */
uint64_t kiln_step_work_done_before(struct kiln_step_work *work, const struct kiln_rank_data *own, size_t end);
/* Own points that are done, including those returned by other ranks. */
uint64_t kiln_step_work_points(const struct kiln_step_work *work, const struct kiln_rank_data *own);
void kiln_step_work_release(struct kiln_step_work *work);

#endif
