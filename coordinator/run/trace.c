#include "coordinator/run/trace.h"

#include <limits.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "coordinator/mpi/agree.h"
#include "coordinator/files/html.h"
#include "coordinator/files/publish.h"
#include "worker/base/memory.h"

enum { NAME = 32, TAG = 11 };

static const char *const rows[KILN_TRACE_ROWS] = {
    "phase",      "pass",       "batch", "batch of another rank", "exchange",
    "on its way", "checkpoint", "wait",  "beside the passes",     "beside the loading"};

struct event {
    enum kiln_trace_row row;
    char name[NAME];
    double begin, end;
    int64_t count;
};

struct kiln_trace {
    MPI_Comm communicator;
    int rank, ranks;
    double zero;
    char host[MPI_MAX_PROCESSOR_NAME];
    struct event *events;
    size_t count, room;
};

int kiln_trace_create(struct kiln_trace **trace, MPI_Comm communicator, struct kiln_error *error)
{
    int length;
    const int status = kiln_agree(communicator, kiln_allocate(trace, 1, sizeof **trace, "the trace", error), error);
    if (status != KILN_OK) {
        kiln_free(trace);
        return status;
    }
    struct kiln_trace *t = *trace;
    t->communicator = communicator;
    (void)MPI_Comm_rank(communicator, &t->rank);
    (void)MPI_Comm_size(communicator, &t->ranks);
    (void)MPI_Get_processor_name(t->host, &length);
    (void)MPI_Barrier(communicator);
    t->zero = MPI_Wtime();
    return KILN_OK;
}

void kiln_trace_destroy(struct kiln_trace **trace)
{
    if (*trace != NULL)
        kiln_free(&(*trace)->events);
    kiln_free(trace);
}

void kiln_trace_add(struct kiln_trace *trace, enum kiln_trace_row row, const char *name, double begin, double end,
                    int64_t count)
{
    if (trace == NULL ||
        kiln_grow(&trace->events, &trace->room, trace->count + 1, sizeof *trace->events, "the trace", NULL) != KILN_OK)
        return;
    struct event *e = &trace->events[trace->count++];
    *e = (struct event){.row = row, .begin = begin, .end = end, .count = count};
    (void)snprintf(e->name, sizeof e->name, "%s", name);
}

/* ---- writing ---- */

/* Names the process and its threads. The names need no escaping: they are kiln's own, and host names have no quotes. */
static void add_names(const struct kiln_trace *t, struct kiln_html *page)
{
    kiln_html_add(page, "%s{\"name\":\"process_name\",\"ph\":\"M\",\"pid\":%d,\"args\":{\"name\":\"rank %d on %s\"}}",
                  t->rank == 0 ? "" : ",\n", t->rank, t->rank, t->host);
    for (int r = 0; r < KILN_TRACE_ROWS; r++)
        kiln_html_add(page,
                      ",\n{\"name\":\"thread_name\",\"ph\":\"M\",\"pid\":%d,\"tid\":%d,\"args\":{\"name\":\"%s\"}}",
                      t->rank, r, rows[r]);
}

static void add_event(const struct kiln_trace *t, const struct event *e, struct kiln_html *page)
{
    const double begin = e->begin > t->zero ? e->begin - t->zero : 0.0, end = e->end > t->zero ? e->end - t->zero : 0.0;
    kiln_html_add(page,
                  ",\n{\"name\":\"%s\",\"cat\":\"%s\",\"ph\":\"X\",\"pid\":%d,\"tid\":%d,\"ts\":%.3f,\"dur\":%.3f",
                  e->name, rows[e->row], t->rank, (int)e->row, 1e6 * begin, 1e6 * (end - begin));
    if (e->count >= 0)
        kiln_html_add(page, ",\"args\":{\"count\":%lld}", (long long)e->count);
    kiln_html_add(page, "}");
}

/* Formats the events of this rank; on rank 0 the head of the file comes first. */
static int make_text(const struct kiln_trace *t, struct kiln_html *page, struct kiln_error *error)
{
    if (t->rank == 0)
        kiln_html_add(page, "{\"displayTimeUnit\":\"ms\",\"traceEvents\":[\n");
    add_names(t, page);
    for (size_t i = 0; i < t->count && page->status == KILN_OK; i++)
        add_event(t, &t->events[i], page);
    if (page->status == KILN_OK && page->size > INT_MAX) /* more than one message can carry */
        return kiln_fail(error, KILN_SYSTEM,
                         "the timeline of rank %d has %zu bytes, and rank 0 can receive at most %d; leave out --trace",
                         t->rank, page->size, INT_MAX);
    return page->status;
}

/* Rank 0: receives the text of another rank. */
static void receive(const struct kiln_trace *t, int rank, struct kiln_html *page)
{
    MPI_Status from;
    int length;
    char *bytes = NULL;
    (void)MPI_Probe(rank, TAG, t->communicator, &from);
    (void)MPI_Get_count(&from, MPI_CHAR, &length);
    const int status = kiln_allocate(&bytes, (size_t)length + 1, 1, "the trace", page->error);
    if (status != KILN_OK)
        kiln_end_all_ranks(status, page->error); /* the other ranks are already sending */
    (void)MPI_Recv(bytes, length, MPI_CHAR, rank, TAG, t->communicator, MPI_STATUS_IGNORE);
    kiln_html_add(page, "%s", bytes);
    kiln_free(&bytes);
}

int kiln_trace_write(const struct kiln_trace *trace, const char *path, struct kiln_error *error)
{
    struct kiln_html page = {.error = error};
    int status;
    KILN_TRY(kiln_agree(trace->communicator, make_text(trace, &page, error), error));
    if (trace->rank != 0)
        (void)MPI_Send(page.text, (int)page.size, MPI_CHAR, 0, TAG, trace->communicator);
    /* receive all texts even after a failure, which the page remembers */
    for (int r = 1; r < trace->ranks && trace->rank == 0; r++)
        receive(trace, r, &page);
end:
    status = status == KILN_OK ? page.status : status;
    if (status == KILN_OK && trace->rank == 0) {
        kiln_html_add(&page, "\n]}\n");
        status = kiln_html_publish(&page, path);
    }
    kiln_html_free(&page);
    return kiln_agree(trace->communicator, status, error);
}
