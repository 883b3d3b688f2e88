#include "coordinator/integrate/radiosity_exchange.h"

#include <string.h>

#define EXCHANGE_BYTES 10e6 /* a second, at the slowest network that is not taken for a dead one */

void kiln_exchange_radiosity(const struct kiln_radiosity_exchange *x, enum kiln_exchange_source source,
                             struct kiln_step_report *report)
{
    struct kiln_solution *s = x->solution;
    const struct kiln_surface *surface = &s->own->surface;
    const double start = MPI_Wtime();
    kiln_control_meet(x->control);
    kiln_control_blocking(x->control, "exchange", (double)surface->point_count * 8.0 / EXCHANGE_BYTES);
    if (source != KILN_EXCHANGE_NEXT_COMPACT)
        kiln_radiosity_allgather_abandon(s->allgather);
    if (source == KILN_EXCHANGE_NEXT)
        memcpy(s->radiosity + surface->first.at, s->own->next, surface->count * sizeof *s->own->next);
    if (source == KILN_EXCHANGE_NEXT_COMPACT)
        kiln_radiosity_allgather_finish(s->allgather, kiln_next_compact(s->own));
    else
        kiln_radiosity_allgather_all(s->allgather);
    kiln_control_blocking(x->control, NULL, 0.0);
    const double end = MPI_Wtime();
    report->exchange_seconds += end - start;
    kiln_trace_add(x->trace, KILN_TRACE_EXCHANGE, source == KILN_EXCHANGE_NEXT_COMPACT ? "end of exchange" : "exchange",
                   start, end, (int64_t)surface->count);
}
