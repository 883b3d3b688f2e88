/* Who computes what of a step when: batches of own tile runs, and work stealing within a node.
 *
 * A rank that has nothing more to do takes work away from the others of its node (mpi/work_queue.h), as far as their
 * backends can (computes_for_others in kiln_backend_info): it computes a range from the end of another rank's work, and
 * writes the results where the owner would. Sums are exact and belong to whoever makes them, so neither results nor
 * checkpoints know who computed what. Where points differ in their samples, as after the pilot of direct light, work is
 * counted by these. A device has to bring the points first, and is idle for a moment between batches: its batches are
 * longer, and it takes as much as is worth that. */
#ifndef KILN_COORDINATOR_INTEGRATE_RUN_BATCHES_H
#define KILN_COORDINATOR_INTEGRATE_RUN_BATCHES_H

#include "coordinator/integrate/company.h"
#include "coordinator/integrate/run/step_work.h"
#include "coordinator/integrate/run/take.h"

struct kiln_batches {
    /* borrowed */
    const struct kiln_integrate_params *params;
    struct kiln_solution *solution;
    struct kiln_step_work *work;
    struct kiln_taker *taker;
    struct kiln_company *company; /* NULL: none */
    /* own */
    const struct kiln_pass *pass; /* of the step under way; NULL: none yet */
    uint32_t with;                /* likewise */
    double rate;                  /* rays a second of this rank in such a step, as far as is known */
    double point_seconds;         /* of its backend (kiln_backend_info) */
    double least_help;            /* s of work that is left to a rank, for this one to take any of it */
    double slowness; /* how many times the time of a batch it shall take (for tests); 1: as long as it takes */
    struct kiln_step_report *report; /* of the step under way */
    int status;                      /* of it, on this rank */
    /* the batch under way */
    const struct kiln_rank_data *data; /* whose tile runs */
    uint64_t points;                   /* taken so far */
    double taken;                      /* work of these: points, or as many of the mean samples */
    struct kiln_selection *selections; /* of a step that leaves points out, with room for selection_room */
    size_t selection_room;
    bool claims;    /* it has all that is left, and claims its tile runs one part after the other */
    size_t claimed; /* own tile runs of it so far */
    double begun;   /* when */
    double since;   /* when the part that is computed now was begun */
};

/* A step begins, or is gone on with: what of it is to do stands in `work`. A failure is kept for kiln_batches_run. */
void kiln_batches_begin(struct kiln_batches *batches, struct kiln_step_report *report, struct kiln_error *error);

/* Collective. Computes until all ranks are done, or there is something else to do for all of them: *event says which
 * (KILN_EVENT_SAVE: call again afterwards; STOP, FAIL, DONE). The error of a rank that failed is on all ranks with
 * KILN_EVENT_FAIL. */
int kiln_batches_run(struct kiln_batches *batches, enum kiln_event *event, struct kiln_error *error);

/* Fills in which points of the batch's tile runs, which are of `data`, the step under way computes: its selections,
 * which are valid until the next call of any of these. KILN_SYSTEM. */
int kiln_batches_choose(struct kiln_batches *batches, const struct kiln_rank_data *data, struct kiln_batch *batch,
                        struct kiln_error *error);

void kiln_batches_release(struct kiln_batches *batches);

#endif
