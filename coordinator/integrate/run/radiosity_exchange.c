#include "coordinator/integrate/run/radiosity_exchange.h"

#include <string.h>

#include "coordinator/integrate/packing.h"
#include "worker/scene/radiosity.h"

/* Random stream for rounding total radiosity; the streams of steps are lower. */
enum { TOTAL_STREAM = 0x10000 };

#define EXCHANGE_BYTES 10e6 /* bytes per second of the slowest network that is not taken for lost */

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

/* Packs the total radiosity of a tile run's points for the exchange. */
static void pack_total(const struct kiln_solution *solution, const struct kiln_tile_run *f)
{
    const struct kiln_surface *surface = &solution->own->surface;
    struct kiln_own_point own = kiln_own_of_global(surface, f->first);
    for (uint64_t rest = f->mask; rest != 0; rest &= rest - 1, own.at++) {
        float albedo[3], total[3];
        kiln_point_albedo(surface, own, albedo);
        for (uint64_t c = 0; c < 3; c++)
            total[c] = solution->own->radiosity != NULL
                           ? solution->own->radiosity[3 * own.at + c]
                           : albedo[c] * (solution->direct[3 * own.at + c] + solution->indirect[3 * own.at + c]);
        solution->own->next[own.at] =
            kiln_radiosity_pack(total, kiln_packing_hash(f, (uint32_t)__builtin_ctzll(rest), TOTAL_STREAM));
    }
}

void kiln_exchange_total_radiosity(const struct kiln_radiosity_exchange *x, struct kiln_step_report *report)
{
    const struct kiln_surface *surface = &x->solution->own->surface;
#pragma omp parallel for schedule(static) num_threads((int)x->threads) if (surface->tile_run_count > 256)
    for (size_t i = 0; i < surface->tile_run_count; i++)
        pack_total(x->solution, &surface->tile_runs[i]);
    kiln_exchange_radiosity(x, KILN_EXCHANGE_NEXT, report);
}
