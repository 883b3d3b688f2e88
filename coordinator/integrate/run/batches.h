/* Batches: decides which rank computes which own tile runs of a step, and when; includes work stealing within a node.
 *
 * An idle rank steals work from other ranks of its node (mpi/work_queue.h), if their backends allow it
 * (computes_for_others in kiln_backend_info). It computes a range from the end of another rank's work, and writes the
 * results where the owner would. Sums are exact and belong to the rank that computes them, so results and checkpoints
 * do not depend on stealing. If points differ in their samples, as after the pilot of direct light, work is measured in
 * samples. A device must load the points first, and idles between batches: its batches are longer, and it steals only
 * amounts worth that. */
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
    const struct kiln_pass *pass;    /* of the step under way; NULL: none yet */
    uint32_t with;                   /* likewise */
    double rate;                     /* rays per second of this rank in such a step, as far as known */
    double point_seconds;            /* of its backend (kiln_backend_info) */
    double least_help;               /* s: smallest remaining work of a rank from which this one steals */
    double slowness;                 /* factor on the time of a batch (for tests); 1: no delay */
    struct kiln_step_report *report; /* of the step under way */
    int status;                      /* of it, on this rank */
    /* the batch under way */
    const struct kiln_rank_data *data; /* whose tile runs */
    uint64_t points;                   /* taken so far */
    double taken;                      /* work of these points: their number, or their samples over the mean */
    struct kiln_selection *selections; /* of a step that leaves points out, with room for selection_room */
    size_t selection_room;
    bool claims;    /* the batch has all remaining work, and claims its tile runs part by part */
    size_t claimed; /* own tile runs of it so far */
    double begun;   /* when */
    double since;   /* time when the current part began */
};

/* Begins or resumes a step; `work` holds the tile runs to compute. A failure is reported by kiln_batches_run. */
void kiln_batches_begin(struct kiln_batches *batches, struct kiln_step_report *report, struct kiln_error *error);

/* Collective. Computes until all ranks are done or all must handle an event: *event is KILN_EVENT_SAVE (call again
 * afterwards), STOP, FAIL or DONE. With KILN_EVENT_FAIL all ranks have the error of the failed one. */
int kiln_batches_run(struct kiln_batches *batches, enum kiln_event *event, struct kiln_error *error);

/* Fills in which points of the batch's tile runs, which are of `data`, the step under way computes: its selections,
 * which are valid until the next call of any of these. KILN_SYSTEM. */
int kiln_batches_choose(struct kiln_batches *batches, const struct kiln_rank_data *data, struct kiln_batch *batch,
                        struct kiln_error *error);

void kiln_batches_release(struct kiln_batches *batches);

#endif
