/* Trace: a timeline of what each rank does, in the JSON format of chrome://tracing and Perfetto.
 *
 * Each rank is a process of the timeline and each kind of event a thread of it. All events are complete events
 * ("ph": "X"). Times are microseconds since a barrier in kiln_trace_create, which aligns the clocks of different hosts
 * to within the time that a barrier takes. */
#ifndef KILN_COORDINATOR_RUN_TRACE_H
#define KILN_COORDINATOR_RUN_TRACE_H

#include <mpi.h>
#include <stdint.h>

#include "worker/base/status.h"

/* Kinds of events. HELP: a batch that was stolen from another rank. EXCHANGE: the rank sends, receives or waits for
 * radiosity. TRAVEL: the messages of a group of points are under way while the rank does something else. BESIDE:
 * low-priority threads prepare files while passes run. LOADING: threads start a device and compile its kernels while
 * the scene is loaded. */
enum kiln_trace_row {
    KILN_TRACE_PHASE,
    KILN_TRACE_PASS,
    KILN_TRACE_BATCH,
    KILN_TRACE_HELP,
    KILN_TRACE_EXCHANGE,
    KILN_TRACE_TRAVEL,
    KILN_TRACE_CHECKPOINT,
    KILN_TRACE_WAIT,
    KILN_TRACE_BESIDE,
    KILN_TRACE_LOADING,
    KILN_TRACE_ROWS
};

struct kiln_trace;

/* Collective. Destroy with kiln_trace_destroy. */
int kiln_trace_create(struct kiln_trace **trace, MPI_Comm communicator, struct kiln_error *error);
void kiln_trace_destroy(struct kiln_trace **trace);

/* Adds an event from `begin` to `end`, times of MPI_Wtime(). `count` is the number of points or bytes that were
 * processed; negative: none is shown. `name` is copied. An event is dropped if memory is short. `trace` may be NULL. */
void kiln_trace_add(struct kiln_trace *trace, enum kiln_trace_row row, const char *name, double begin, double end,
                    int64_t count);

/* Collective. Rank 0 writes the events of all ranks to the file. */
int kiln_trace_write(const struct kiln_trace *trace, const char *path, struct kiln_error *error);

#endif
