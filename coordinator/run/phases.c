#include "coordinator/run/phases.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

/* CPU seconds of all threads of the process. */
static double processor_time(void)
{
    struct timespec time = {0, 0};
    (void)clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
    return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

static size_t find(struct kiln_phases *phases, const char *name)
{
    for (size_t i = 0; i < phases->count; i++)
        if (strcmp(phases->name[i], name) == 0)
            return i;
    assert(phases->count < KILN_PHASES_MAX);
    phases->name[phases->count] = name;
    phases->seconds[phases->count] = phases->processor[phases->count] = 0.0;
    return phases->count++;
}

void kiln_phase(struct kiln_phases *phases, const char *name)
{
    const double now = MPI_Wtime(), processor = processor_time();
    if (phases->begin == 0.0)
        phases->begin = now;
    if (phases->since != 0.0) {
        phases->seconds[phases->present] += now - phases->since;
        phases->processor[phases->present] += processor - phases->processor_since;
        kiln_trace_add(phases->trace, KILN_TRACE_PHASE, phases->name[phases->present], phases->since, now, -1);
    }
    phases->since = 0.0;
    if (name == NULL)
        return;
    phases->present = find(phases, name);
    phases->since = now;
    phases->processor_since = processor;
    kiln_watchdog_phase(phases->watchdog, name);
}

void kiln_phase_add(struct kiln_phases *phases, const char *name, double seconds)
{
    phases->seconds[find(phases, name)] += seconds;
}

void kiln_phase_part(struct kiln_phases *phases, const char *whole, const char *part, double seconds)
{
    const size_t from = find(phases, whole), to = find(phases, part);
    const double moved = fmin(seconds, phases->seconds[from]),
                 processor = moved > 0.0 ? phases->processor[from] * moved / phases->seconds[from] : 0.0;
    phases->seconds[from] -= moved;
    phases->seconds[to] += moved;
    phases->processor[from] -= processor;
    phases->processor[to] += processor;
}

void kiln_phase_rest(struct kiln_phases *phases, double before)
{
    double rest = before + MPI_Wtime() - phases->begin;
    for (size_t i = 0; i < phases->count; i++)
        rest -= phases->seconds[i];
    kiln_phase_add(phases, "other", fmax(rest, 0.0));
}

json_t *kiln_phases_json(const struct kiln_phases *phases, MPI_Comm communicator, double *all)
{
    int rank, ranks;
    (void)MPI_Comm_rank(communicator, &rank);
    (void)MPI_Comm_size(communicator, &ranks);
    double processor[KILN_PHASES_MAX] = {0.0};
    (void)MPI_Reduce(phases->processor, processor, KILN_PHASES_MAX, MPI_DOUBLE, MPI_SUM, 0, communicator);
    (void)MPI_Gather(phases->seconds, KILN_PHASES_MAX, MPI_DOUBLE, all, KILN_PHASES_MAX, MPI_DOUBLE, 0, communicator);
    if (rank != 0)
        return NULL;
    json_t *array = json_array();
    for (size_t i = 0; i < phases->count; i++) {
        double low = INFINITY, high = 0.0, sum = 0.0;
        json_t *per_rank = json_array();
        for (int r = 0; r < ranks; r++) {
            const double seconds = all[(size_t)r * KILN_PHASES_MAX + i];
            low = fmin(low, seconds);
            high = fmax(high, seconds);
            sum += seconds;
            json_array_append_new(per_rank, json_real(seconds));
        }
        const double mean = sum / ranks;
        json_array_append_new(array, json_pack("{s:s, s:{s:f, s:f, s:f}, s:o, s:f, s:o}", "name", phases->name[i],
                                               "seconds", "min", low, "avg", mean, "max", high, "processor_seconds",
                                               processor[i] > 0.0 ? json_real(processor[i]) : json_null(), "imbalance",
                                               mean > 0.0 ? high / mean - 1.0 : 0.0, "per_rank", per_rank));
    }
    return array;
}
