/* Which own tile runs of the step under way are still to be computed, and how far the others have got. The ranges to do
 * are opened one by one on the rank's work queue (mpi/work_queue.h), where other ranks of the node may take from. */
#ifndef KILN_COORDINATOR_INTEGRATE_RUN_STEP_WORK_H
#define KILN_COORDINATOR_INTEGRATE_RUN_STEP_WORK_H

#include "coordinator/field/rank_data.h"

/* Zero: nothing to do. Release with kiln_step_work_release. */
struct kiln_step_work {
    /* todo[todo_first .. todo_count) are the ranges to do, in order; what is left of the first one is on the queue */
    struct kiln_range *todo;
    size_t todo_first, todo_count, todo_room;
    uint64_t points_done; /* own ones, by this rank or by earlier runs; not what others have returned */
    size_t sent;          /* own tile runs before this one are done, as far as was seen */
    /* there are gaps before the present range: others have not returned what they took of one before it */
    bool held;
    bool measured; /* the costs of all own tile runs are of this step */
};

/* All own tile runs are to be done. KILN_SYSTEM. */
int kiln_step_work_begin(struct kiln_step_work *work, size_t tile_runs, struct kiln_error *error);
/* Begins the own queue with what is to do. */
void kiln_step_work_offer(struct kiln_step_work *work, const struct kiln_rank_data *own);
/* Adds the own tile runs [first, end), which come after all that were added before. KILN_SYSTEM. */
int kiln_step_work_add(struct kiln_step_work *work, size_t first, size_t end, struct kiln_error *error);
/* Collective on the node, of whose ranks `node_ranks` are seen here. Waits until other ranks have none of the own work,
 * and brings `todo` up to date: what is not in it is done. */
void kiln_step_work_settle(struct kiln_step_work *work, const struct kiln_rank_data *own, struct kiln_node_memory *node,
                           int node_ranks);
/* Whether any own work is left to take; goes on to the next range when the present one is gone. */
bool kiln_step_work_any(struct kiln_step_work *work, const struct kiln_rank_data *own);
/* All own tile runs before `end` are done, but for those that others have. Gives the number of own points from the
 * first on that are done without a gap, as far as was seen. */
uint64_t kiln_step_work_done_before(struct kiln_step_work *work, const struct kiln_rank_data *own, size_t end);
/* Own points that are done, with those that others have returned. */
uint64_t kiln_step_work_points(const struct kiln_step_work *work, const struct kiln_rank_data *own);
void kiln_step_work_release(struct kiln_step_work *work);

#endif
