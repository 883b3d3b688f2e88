#include "coordinator/integrate/run/trial.h"

#include "coordinator/job/faults.h"
#include "coordinator/integrate/run/repartition.h"
#include "coordinator/integrate/run/repartition_rule.h"
#include "coordinator/mpi/agree.h"

struct trial {
    const struct kiln_integrate_params *params;
    struct kiln_solution *solution;
    const struct kiln_step *step;
    uint64_t rays; /* that nobody counts */
};

/* Collective; the same on all ranks. */
static bool is_due(const struct trial *t)
{
    const struct kiln_integrate_params *p = t->params;
    uint64_t least = p->surface->count;
    int alone = kiln_node_data_count(t->solution->node_data) == p->ranks;
    (void)MPI_Allreduce(MPI_IN_PLACE, &least, 1, MPI_UINT64_T, MPI_MIN, p->communicator);
    (void)MPI_Allreduce(MPI_IN_PLACE, &alone, 1, MPI_INT, MPI_MAX, p->communicator);
    return alone == 0 && kiln_trial_is_due(p->settings->rebalance, t->step, least);
}

/* Returns the end of the stretch that begins at this rank's tile run `first`. */
static size_t stretch_end(const struct kiln_surface *surface, size_t first)
{
    uint64_t points = 0;
    while (first < surface->tile_run_count && points < KILN_TRIAL_STRETCH)
        points += surface->tile_runs[first++].count;
    return first;
}

/* Computes some tile runs in the middle of a stretch. Their cost per point is used for the whole stretch. */
static int try_stretch(struct trial *t, size_t first, size_t end, struct kiln_error *error)
{
    const struct kiln_integrate_params *p = t->params;
    const struct kiln_surface *surface = p->surface;
    const size_t least = p->threads > KILN_TRIAL_TILE_RUNS ? p->threads : KILN_TRIAL_TILE_RUNS,
                 count = end - first < least ? end - first : least, begin = first + (end - first - count) / 2;
    const struct kiln_batch batch = {.first = begin,
                                     .count = count,
                                     .stream = t->step->stream,
                                     .samples = t->step->samples,
                                     .first_sample = t->step->first_sample};
    const uint64_t points = kiln_tile_runs_points(&surface->tile_runs[begin], &surface->tile_runs[begin + count - 1]);
    const double start = MPI_Wtime();
    const int status = kiln_backend_run(p->backend, t->step->pass, t->step->parameters, &batch, &t->rays, error);
    const double seconds =
        (MPI_Wtime() - start) * kiln_faults_slowness(&p->settings->faults, (uint32_t)p->rank) / (double)points;
    for (size_t f = first; f < end; f++)
        t->solution->own->cost[f] = (float)(seconds * (double)surface->tile_runs[f].count);
    return status;
}

/* Tries all stretches, until a stop is requested. */
static int try_all(struct trial *t, struct kiln_error *error)
{
    const size_t count = t->params->surface->tile_run_count;
    const struct kiln_stop *stop = kiln_control_stop(t->params->control);
    int status = KILN_OK;
    for (size_t first = 0, end; status == KILN_OK && first < count && !kiln_stop_asked(stop); first = end) {
        end = stretch_end(t->params->surface, first);
        status = try_stretch(t, first, end, error);
    }
    return status;
}

/* Collective. Waits for the slowest rank; *stopped: some rank did not try all. */
static int end_trial(const struct trial *t, int status, int *stopped, struct kiln_error *error)
{
    struct kiln_control *control = t->params->control;
    *stopped = kiln_stop_asked(kiln_control_stop(control));
    kiln_control_meet(control);
    kiln_control_blocking(control, "trying what points cost", 0.0);
    status = kiln_agree(t->params->communicator, status, error);
    (void)MPI_Allreduce(MPI_IN_PLACE, stopped, 1, MPI_INT, MPI_MAX, t->params->communicator);
    kiln_control_blocking(control, NULL, 0.0);
    return status;
}

int kiln_trial_run(const struct kiln_integrate_params *p, struct kiln_solution *solution, struct kiln_company *company,
                   const struct kiln_step *first, struct kiln_error *error)
{
    struct trial t = {p, solution, first, 0};
    struct kiln_integrate_report *report = &solution->report;
    const double start = MPI_Wtime();
    if (!is_due(&t))
        return KILN_OK;
    int stopped;
    int status = end_trial(&t, try_all(&t, error), &stopped, error);
    if (status == KILN_OK && stopped == 0)
        status = kiln_repartition_by_trial(p, solution, company, first, &report->trial, error);
    report->trial_seconds = MPI_Wtime() - start;
    kiln_trace_add(p->trace, KILN_TRACE_PASS, "trial of points", start, start + report->trial_seconds,
                   (int64_t)p->surface->count);
    return status;
}
