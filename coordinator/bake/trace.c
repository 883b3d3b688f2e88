#include "coordinator/bake/trace.h"

#include <stdio.h>
#include <string.h>

#include "coordinator/cli/agree.h"
#include "coordinator/output/publish.h"
#include "worker/base/memory.h"

enum { NAME = 32, LINE = 256, TAG = 11 };

static const char *const rows[KILN_TRACE_ROWS] = {"phase", "pass", "batch", "exchange", "on its way", "checkpoint", "wait"};

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

void kiln_trace_add(struct kiln_trace *trace, enum kiln_trace_row row, const char *name, double begin, double end, int64_t count)
{
    if (trace == NULL || kiln_grow(&trace->events, &trace->room, trace->count + 1, sizeof *trace->events, "the trace", NULL) != KILN_OK)
        return;
    struct event *e = &trace->events[trace->count++];
    *e = (struct event){.row = row, .begin = begin, .end = end, .count = count};
    (void)snprintf(e->name, sizeof e->name, "%s", name);
}

/* ---- writing ---- */

struct text {
    char *bytes;
    size_t length, room;
};

static int append(struct text *text, const char *line, struct kiln_error *error)
{
    const size_t more = strlen(line);
    const int status = kiln_grow(&text->bytes, &text->room, text->length + more + 1, 1, "the trace", error);
    if (status != KILN_OK)
        return status;
    memcpy(text->bytes + text->length, line, more + 1);
    text->length += more;
    return KILN_OK;
}

/* Who the process and its threads are. Names are kiln's own words, and a host's hold no quotes. */
static int append_names(const struct kiln_trace *t, struct text *text, struct kiln_error *error)
{
    char line[LINE + MPI_MAX_PROCESSOR_NAME];
    (void)snprintf(line, sizeof line, "%s{\"name\":\"process_name\",\"ph\":\"M\",\"pid\":%d,\"args\":{\"name\":\"rank %d on %s\"}}",
                   t->rank == 0 ? "" : ",\n", t->rank, t->rank, t->host);
    int status = append(text, line, error);
    for (int r = 0; r < KILN_TRACE_ROWS && status == KILN_OK; r++) {
        (void)snprintf(line, sizeof line, ",\n{\"name\":\"thread_name\",\"ph\":\"M\",\"pid\":%d,\"tid\":%d,\"args\":{\"name\":\"%s\"}}", t->rank, r, rows[r]);
        status = append(text, line, error);
    }
    return status;
}

static int append_event(const struct kiln_trace *t, const struct event *e, struct text *text, struct kiln_error *error)
{
    char line[LINE], count[48] = "";
    const double begin = e->begin > t->zero ? e->begin - t->zero : 0.0, end = e->end > t->zero ? e->end - t->zero : 0.0;
    if (e->count >= 0)
        (void)snprintf(count, sizeof count, ",\"args\":{\"count\":%lld}", (long long)e->count);
    (void)snprintf(line, sizeof line, ",\n{\"name\":\"%s\",\"cat\":\"%s\",\"ph\":\"X\",\"pid\":%d,\"tid\":%d,\"ts\":%.3f,\"dur\":%.3f%s}", e->name,
                   rows[e->row], t->rank, (int)e->row, 1e6 * begin, 1e6 * (end - begin), count);
    return append(text, line, error);
}

static int make_text(const struct kiln_trace *t, struct text *text, struct kiln_error *error)
{
    int status = append_names(t, text, error);
    for (size_t i = 0; i < t->count && status == KILN_OK; i++)
        status = append_event(t, &t->events[i], text, error);
    return status;
}

/* Rank 0: takes another rank's text. */
static int receive(const struct kiln_trace *t, int rank, struct text *text, struct kiln_error *error)
{
    MPI_Status from;
    int length;
    (void)MPI_Probe(rank, TAG, t->communicator, &from);
    (void)MPI_Get_count(&from, MPI_CHAR, &length);
    struct text one = {0};
    int status = kiln_grow(&one.bytes, &one.room, (size_t)length + 1, 1, "the trace", error);
    if (status != KILN_OK)
        MPI_Abort(t->communicator, status); /* the others are sending */
    (void)MPI_Recv(one.bytes, length, MPI_CHAR, rank, TAG, t->communicator, MPI_STATUS_IGNORE);
    one.bytes[length] = '\0';
    status = append(text, one.bytes, error);
    kiln_free(&one.bytes);
    return status;
}

int kiln_trace_write(const struct kiln_trace *trace, const char *path, struct kiln_error *error)
{
    struct text text = {0};
    int status = trace->rank == 0 ? append(&text, "{\"displayTimeUnit\":\"ms\",\"traceEvents\":[\n", error) : KILN_OK;
    if (status == KILN_OK)
        status = make_text(trace, &text, error);
    status = kiln_agree(trace->communicator, status, error);
    if (status == KILN_OK && trace->rank != 0)
        (void)MPI_Send(text.bytes, (int)text.length, MPI_CHAR, 0, TAG, trace->communicator);
    for (int r = 1; r < trace->ranks && trace->rank == 0 && status == KILN_OK; r++)
        status = receive(trace, r, &text, error);
    if (status == KILN_OK && trace->rank == 0)
        status = append(&text, "\n]}\n", error);
    if (status == KILN_OK && trace->rank == 0)
        status = kiln_publish_bytes(path, text.bytes, text.length, error);
    kiln_free(&text.bytes);
    return kiln_agree(trace->communicator, status, error);
}
