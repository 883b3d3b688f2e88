/* What each rank did when, for chrome://tracing and Perfetto: phases, passes, batches, help, exchanges, checkpoints,
 * waits.
 *
 * A rank is a process of the timeline, a category a thread of it; every event is complete ("ph": "X") with microseconds
 * since the ranks met in kiln_trace_create. Clocks of different hosts are set by that meeting, to within the time a
 * barrier takes. */
#ifndef KILN_COORDINATOR_RUN_TRACE_H
#define KILN_COORDINATOR_RUN_TRACE_H

#include <mpi.h>
#include <stdint.h>

#include "worker/base/status.h"

/* HELP: batches of another rank's share. EXCHANGE: a rank is busy with it, or waits; TRAVEL: a group of points is on
 * its way, while other things are done. */
enum kiln_trace_row {
    KILN_TRACE_PHASE,
    KILN_TRACE_PASS,
    KILN_TRACE_BATCH,
    KILN_TRACE_HELP,
    KILN_TRACE_EXCHANGE,
    KILN_TRACE_TRAVEL,
    KILN_TRACE_CHECKPOINT,
    KILN_TRACE_WAIT,
    KILN_TRACE_ROWS
};

struct kiln_trace;

/* Collective. Destroy with kiln_trace_destroy. */
int kiln_trace_create(struct kiln_trace **trace, MPI_Comm communicator, struct kiln_error *error);
void kiln_trace_destroy(struct kiln_trace **trace);

/* From `begin` to `end`, MPI_Wtime(). `count` says how much was done (points, bytes); negative: nothing to say. `name`
 * is copied. What finds no memory is left out. A NULL trace takes nothing. */
void kiln_trace_add(struct kiln_trace *trace, enum kiln_trace_row row, const char *name, double begin, double end,
                    int64_t count);

/* Collective. Rank 0 writes the events of all ranks to the file. */
int kiln_trace_write(const struct kiln_trace *trace, const char *path, struct kiln_error *error);

#endif
