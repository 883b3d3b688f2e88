#include "coordinator/integrate/run/repartition.h"

#include <math.h>

#include "coordinator/integrate/run/repartition_rule.h"
#include "coordinator/mpi/agree.h"
#include "worker/base/memory.h"

/* Borrowed. */
struct repartition {
    const struct kiln_integrate_params *params;
    struct kiln_solution *solution;
    struct kiln_company *company;
    double *seconds; /* receives the time of the move; NULL: the time is counted elsewhere */
};

/* Work of all ranks in the last step, known to all. */
struct work {
    double *before; /* work of all ranks before rank r, s; ranks + 1 entries */
    double total;
    double longest; /* of a rank, or of the mean rank of a node whose ranks help each other */
};

static double own_work(const struct repartition *s)
{
    double sum = 0.0;
    for (size_t f = 0; f < s->params->surface->tile_run_count; f++)
        sum += (double)s->solution->own->cost[f];
    return sum;
}

/* Collective. */
static int learn_work(const struct repartition *s, struct work *w, struct kiln_error *error)
{
    const struct kiln_integrate_params *p = s->params;
    const int status =
        kiln_agree(p->communicator,
                   kiln_allocate(&w->before, (size_t)p->ranks + 1, sizeof *w->before, "the ranks' work", error), error);
    if (status != KILN_OK)
        return status;
    const double own = own_work(s);
    double longest = own;
    (void)MPI_Allgather(&own, 1, MPI_DOUBLE, w->before + 1, 1, MPI_DOUBLE, p->communicator);
    if (kiln_node_data_count(s->solution->node_data) > 1) {
        (void)MPI_Allreduce(MPI_IN_PLACE, &longest, 1, MPI_DOUBLE, MPI_SUM, kiln_node_communicator(p->node));
        longest /= kiln_node_data_count(s->solution->node_data);
    }
    (void)MPI_Allreduce(&longest, &w->longest, 1, MPI_DOUBLE, MPI_MAX, p->communicator);
    for (int r = 0; r < p->ranks; r++)
        w->before[r + 1] += w->before[r];
    w->total = w->before[p->ranks];
    return KILN_OK;
}

/* ---- new bounds ---- */

/* Whether this rank's tile run f > 0 begins a cell (or an object). Ranges should not divide these. */
static bool begins_whole(const struct repartition *s, size_t f)
{
    const struct kiln_tile_run *tile_runs = s->params->surface->tile_runs;
    return s->params->settings->whole_objects ? tile_runs[f].map != tile_runs[f - 1].map
                                              : tile_runs[f].cell != tile_runs[f - 1].cell;
}

/* Returns this rank's tile run at which the next range should begin: the first one before which the work of all ranks
 * reaches `ideal` seconds, where `begin` is the work of the ranks before this one. If a cell begins nearby, the range
 * begins there. */
static size_t bound_at(const struct repartition *s, double begin, double ideal, double slack)
{
    const size_t count = s->params->surface->tile_run_count;
    const float *cost = s->solution->own->cost;
    size_t best = count, whole = count;
    double least = INFINITY, nearest = slack, at = begin;
    for (size_t f = 0; f < count && at <= ideal + slack; at += (double)cost[f++]) {
        const double off = fabs(at - ideal);
        if (off < least) {
            least = off;
            best = f;
        }
        if (f > 0 && off <= nearest && begins_whole(s, f)) {
            nearest = off;
            whole = f;
        }
    }
    return whole < count ? whole : best;
}

/* Collective. Computes the new bounds of ranges. Each rank finds those that fall into its own work. */
static int make_bounds(const struct repartition *s, const struct work *w, const struct kiln_range_bounds *before,
                       struct kiln_range_bounds *after, struct kiln_error *error)
{
    const struct kiln_integrate_params *p = s->params;
    const struct kiln_surface *surface = p->surface;
    *after = (struct kiln_range_bounds){{NULL}};
    const int status = kiln_agree(p->communicator, kiln_range_bounds_create(after, p->ranks, error), error);
    if (status != KILN_OK)
        return status;
    for (int k = 1; k < p->ranks; k++) {
        const double ideal = w->total * k / p->ranks;
        if (ideal < w->before[p->rank] || ideal >= w->before[p->rank + 1])
            continue;
        const size_t f = bound_at(s, w->before[p->rank], ideal, KILN_BOUND_SLACK * w->total / p->ranks);
        after->of[KILN_DOMAIN_TILE_RUN][k] = before->of[KILN_DOMAIN_TILE_RUN][p->rank] + f;
        after->of[KILN_DOMAIN_POINT][k] =
            f < surface->tile_run_count ? surface->tile_runs[f].first.at : surface->first.at + surface->count;
        after->of[KILN_DOMAIN_PIECE][k] = before->of[KILN_DOMAIN_PIECE][p->rank] + surface->piece_base[f];
        after->of[KILN_DOMAIN_AREA_CDF][k] = before->of[KILN_DOMAIN_AREA_CDF][p->rank] + surface->area_cdf_base[f];
    }
    for (int u = 0; u < KILN_DOMAINS; u++) {
        after->of[u][p->ranks] = before->of[u][p->ranks];
        (void)MPI_Allreduce(MPI_IN_PLACE, after->of[u], p->ranks + 1, MPI_UINT64_T, MPI_MAX, p->communicator);
        for (int k = 1; k < p->ranks; k++) /* bounds may coincide where tile runs take no time */
            after->of[u][k] = after->of[u][k] < after->of[u][k - 1] ? after->of[u][k - 1] : after->of[u][k];
    }
    return KILN_OK;
}

/* Collective. Returns the largest number of points that any rank receives from others. */
static uint64_t most_moved(const struct repartition *s, const struct kiln_range_bounds *before,
                           const struct kiln_range_bounds *after)
{
    const int rank = s->params->rank;
    const uint64_t *old = before->of[KILN_DOMAIN_POINT] + rank, *new = after->of[KILN_DOMAIN_POINT] + rank;
    const uint64_t begin = old[0] > new[0] ? old[0] : new[0], end = old[1] < new[1] ? old[1] : new[1];
    uint64_t moved = new[1] - new[0] - (end > begin ? end - begin : 0);
    (void)MPI_Allreduce(MPI_IN_PLACE, &moved, 1, MPI_UINT64_T, MPI_MAX, s->params->communicator);
    return moved;
}

/* Collective. Estimates the time of a move in which a rank receives so many points, s. */
static double cost_of(const struct repartition *s, uint64_t moved)
{
    const double points = (double)s->params->surface->count;
    double bytes = points > 0.0 ? (double)kiln_node_data_bytes(s->solution->node_data) / points : 0.0; /* of a point */
    (void)MPI_Allreduce(MPI_IN_PLACE, &bytes, 1, MPI_DOUBLE, MPI_MAX, s->params->communicator);
    return kiln_repartition_cost((double)moved, bytes);
}

/* ---- moving ---- */

/* Collective. The exchange goes by the new ranges. */
static int follow(const struct repartition *s, struct kiln_error *error)
{
    const struct kiln_integrate_params *p = s->params;
    struct kiln_radiosity_allgather *allgather = s->solution->allgather;
    int status;
    KILN_TRY(kiln_radiosity_allgather_set_range(allgather, p->surface->first, p->surface->count, error));
    KILN_TRY(kiln_agree(p->communicator, kiln_backend_set_surface(p->backend, p->surface, error), error));
    KILN_TRY(kiln_company_after_move(s->company, error));
end:
    return status;
}

/* Collective. */
static int redistribute(const struct repartition *s, const struct kiln_range_bounds *before,
                        const struct kiln_range_bounds *after, double expected, struct kiln_error *error)
{
    const struct kiln_integrate_params *p = s->params;
    const double start = MPI_Wtime();
    kiln_control_blocking(p->control, "moving points between ranks", 60.0 + 10.0 * expected);
    if (p->beside != NULL)
        p->beside->stop(p->beside->context);
    int status = kiln_company_before_move(s->company, after->of[KILN_DOMAIN_POINT], error);
    if (status == KILN_OK)
        status = kiln_node_data_redistribute(s->solution->node_data, p->communicator, before, after,
                                             p->settings->exchange_limit, error);
    if (status == KILN_OK) {
        kiln_solution_refresh(s->solution);
        status = follow(s, error);
    }
    kiln_control_blocking(p->control, NULL, 0.0);
    const double end = MPI_Wtime();
    if (s->seconds != NULL)
        *s->seconds += end - start;
    kiln_trace_add(p->trace, KILN_TRACE_EXCHANGE, "points to other ranks", start, end, (int64_t)p->surface->count);
    return status;
}

/* Collective. */
static int consider(const struct repartition *s, const struct work *w, struct kiln_step_balance *b,
                    struct kiln_error *error)
{
    const struct kiln_integrate_params *p = s->params;
    struct kiln_range_bounds before, after = {{NULL}};
    int status;
    KILN_TRY(kiln_node_data_bounds(s->solution->node_data, p->communicator, &before, error));
    KILN_TRY(make_bounds(s, w, &before, &after, error));
    b->points = most_moved(s, &before, &after);
    b->cost = cost_of(s, b->points);
    b->moved = b->points > 0 && kiln_repartition_pays(p->settings->rebalance, b->gain, b->cost);
    if (b->moved)
        KILN_TRY(redistribute(s, &before, &after, b->cost, error));
end:
    kiln_range_bounds_destroy(&before);
    kiln_range_bounds_destroy(&after);
    return status;
}

/* Collective. `b` is of the last report. */
static int judge(const struct repartition *s, const struct kiln_repartition_steps *steps, struct kiln_step_balance *b,
                 struct kiln_error *error)
{
    const struct kiln_integrate_params *p = s->params;
    struct work w = {.before = NULL};
    int status = learn_work(s, &w, error);
    if (status == KILN_OK && w.total > 0.0) {
        const double mean = w.total / p->ranks;
        b->judged = true;
        b->imbalance = w.longest / mean - 1.0;
        b->gain = kiln_repartition_gain(steps, w.longest, mean);
        if (kiln_repartition_is_asked(p->settings->rebalance, b->gain))
            status = consider(s, &w, b, error);
    }
    kiln_free(&w.before);
    return status;
}

/* Collective. `last` is of the step whose costs are known. */
static int decide(const struct repartition *s, const struct kiln_step *last, const struct kiln_step *next,
                  struct kiln_step_balance *balance, struct kiln_error *error)
{
    const struct kiln_integrate_params *p = s->params;
    struct kiln_repartition_steps steps = {.last = *last, .next = *next};
    kiln_control_blocking(p->control, "judging the balance of the ranks", 0.0);
    int status =
        kiln_agree(p->communicator,
                   kiln_integrate_outlook(p->settings, &s->solution->report.steps, next, &steps.outlook, error), error);
    if (status == KILN_OK && kiln_repartition_is_due(p->settings->rebalance, &steps))
        status = judge(s, &steps, balance, error);
    kiln_control_blocking(p->control, NULL, 0.0);
    return status;
}

int kiln_repartition(const struct kiln_integrate_params *p, struct kiln_solution *solution,
                     struct kiln_company *company, const struct kiln_step *next, struct kiln_error *error)
{
    /* copies, since the reports may be reallocated */
    const struct kiln_step last = kiln_solution_step(solution)->step;
    struct kiln_step_balance balance = kiln_solution_step(solution)->balance;
    double seconds = 0.0;
    const struct repartition s = {p, solution, company, &seconds};
    const int status = decide(&s, &last, next, &balance, error);
    kiln_solution_step(solution)->balance = balance;
    kiln_solution_step(solution)->exchange_seconds += seconds;
    return status;
}

int kiln_repartition_by_trial(const struct kiln_integrate_params *p, struct kiln_solution *solution,
                              struct kiln_company *company, const struct kiln_step *first,
                              struct kiln_step_balance *balance, struct kiln_error *error)
{
    const struct repartition s = {p, solution, company, NULL};
    return decide(&s, first, first, balance, error);
}
