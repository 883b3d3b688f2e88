#include "coordinator/plan/simulate_light.h"

#include <math.h>

#include "coordinator/integrate/run/repartition_rule.h"
#include "coordinator/job/faults.h"
#include "coordinator/surface/surface_build.h"
#include "worker/base/memory.h"

static const double BATCH_SECONDS = 1.0; /* work in a batch, unless checkpoints or signs of life need shorter ones */

struct state {
    const struct kiln_light_simulation *s;
    uint32_t ranks;
    double density;
    double *points, *cost[KILN_COST_KINDS_MAX]; /* sums over the cells before each cell, and over all */
    double *bounds, *next;                      /* points before each rank's, and all; now, and after a repartition */
    double *work; /* s: work of the ranks before each rank, and of all, as seen in the last step */
    /* work of the rank that has most over the mean, because tile runs are whole */
    double grain;
    bool helps; /* ranks of a node steal work from each other */
};

/* Times of a simulated step. Seconds. */
struct shown {
    double seconds; /* until the last rank is done */
    double longest; /* work of a rank, or mean work of ranks that help each other */
    double total;   /* of all ranks */
};

/* ---- cells ---- */

static int make_cells(struct state *t, struct kiln_error *error)
{
    const struct kiln_light_simulation *s = t->s;
    int status;
    KILN_TRY(kiln_allocate(&t->points, s->cell_count + 1, sizeof *t->points, "the simulated cells", error));
    for (size_t i = 0; i < s->cell_count; i++)
        t->points[i + 1] = t->points[i] + (double)s->cell_points[i];
    for (uint32_t l = 0; l < s->steps->kind_count; l++) {
        KILN_TRY(kiln_allocate(&t->cost[l], s->cell_count + 1, sizeof *t->cost[l], "the simulated cells", error));
        for (size_t i = 0; i < s->cell_count; i++)
            t->cost[l][i + 1] = t->cost[l][i] + (double)s->cell_points[i] * s->cell_cost[l][i];
    }
end:
    return status;
}

/* The cell in which a sum over cells reaches `value`. */
static size_t cell_at(const struct state *t, const double *sums, double value)
{
    size_t low = 0, high = t->s->cell_count;
    while (low + 1 < high) {
        const size_t middle = (low + high) / 2;
        if (sums[middle] <= value)
            low = middle;
        else
            high = middle;
    }
    return low;
}

/* Converts between sums over cells: the value of `to` where `from` is `value`, interpolated within a cell. */
static double at(const struct state *t, const double *from, const double *to, double value)
{
    const size_t cell = cell_at(t, from, value);
    const double width = from[cell + 1] - from[cell];
    const double part = width > 0.0 ? fmin(1.0, fmax(0.0, value - from[cell]) / width) : 0.0;
    return to[cell] + part * (to[cell + 1] - to[cell]);
}

static double cost_before(const struct state *t, uint32_t kind, uint32_t rank)
{
    return at(t, t->points, t->cost[kind], t->bounds[rank]);
}

/* ---- ranks ---- */

static uint32_t ranks_of_node(const struct state *t) { return t->s->ranks_per_node > 0 ? t->s->ranks_per_node : 1; }

/* First rank of the group that helps each other with `rank`, as kiln_node_create groups the ranks of a node. */
static uint32_t group_begin(const struct state *t, uint32_t rank)
{
    const uint32_t node = ranks_of_node(t), most = t->s->shared_memory_ranks, in_node = rank % node;
    return !t->helps ? rank : most > 0 ? rank - in_node % most : rank - in_node;
}

static uint32_t group_end(const struct state *t, uint32_t begin)
{
    const uint32_t node = ranks_of_node(t), most = t->s->shared_memory_ranks, node_end = begin - begin % node + node;
    const uint32_t end = !t->helps ? begin + 1 : most > 0 && begin + most < node_end ? begin + most : node_end;
    return end < t->ranks ? end : t->ranks;
}

static double slowness(const struct state *t, uint32_t rank)
{
    return kiln_faults_slowness(&t->s->settings->faults, rank);
}

/* Slowdown of a group of ranks that share their work, relative to ranks of usual speed. */
static double group_slowness(const struct state *t, uint32_t begin, uint32_t end)
{
    const uint32_t slow = t->s->settings->faults.slow_rank;
    if (slow < begin || slow >= end)
        return 1.0;
    return (end - begin) / (end - begin - 1.0 + 1.0 / slowness(t, slow));
}

/* Sets the first bounds, as the partition does: between whole cells where that is even enough, else by numbers of
 * points. */
static int first_bounds(struct state *t, struct kiln_error *error)
{
    const struct kiln_light_simulation *s = t->s;
    const double all = t->points[s->cell_count], tile_runs = fmax(1.0, (double)s->tile_runs * t->density) / t->ranks;
    uint64_t *begins = NULL;
    double most = INFINITY;
    int status = KILN_OK;
    if (t->ranks <= s->cell_count) {
        status = kiln_allocate(&begins, (size_t)t->ranks + 1, sizeof *begins, "the simulated ranks", error);
        if (status == KILN_OK) {
            kiln_partition_cut(s->cell_points, s->cell_count, t->ranks, begins);
            most = 0.0;
        }
        for (uint32_t r = 0; status == KILN_OK && r < t->ranks; r++)
            most = fmax(most, t->points[begins[r + 1]] - t->points[begins[r]]);
    }
    const bool whole = most <= (1.0 + KILN_PARTITION_IMBALANCE) * all / t->ranks;
    t->grain = whole ? 1.0 : ceil(tile_runs) / tile_runs;
    for (uint32_t r = 0; status == KILN_OK && r <= t->ranks; r++)
        t->bounds[r] = whole ? t->points[begins[r]] : all * r / t->ranks;
    kiln_free(&begins);
    return status;
}

static double most_points(const struct state *t)
{
    double most = 0.0;
    for (uint32_t r = 0; r < t->ranks; r++)
        most = fmax(most, t->bounds[r + 1] - t->bounds[r]);
    return most * t->density;
}

/* ---- a step ---- */

/* Mean wait at the end of a step: ranks that help each other end up to one smallest batch apart, which is 0.02 s of
 * work, or one tile run per thread. */
static double wait_for_batch(const struct state *t, uint32_t kind)
{
    const double tile_run = t->cost[kind][t->s->cell_count] / fmax(1.0, (double)t->s->tile_runs);
    return 0.5 * fmax(KILN_LEAST_BATCH, tile_run * t->s->threads);
}

static struct shown run_step(const struct state *t, uint32_t kind)
{
    struct shown p = {0.0, 0.0, 0.0};
    for (uint32_t begin = 0, end; begin < t->ranks; begin = end) {
        double alone = 0.0, work = 0.0, before = cost_before(t, kind, begin);
        end = group_end(t, begin);
        for (uint32_t r = begin; r < end; r++) {
            const double after = cost_before(t, kind, r + 1), own = t->density * (after - before);
            alone = fmax(alone, slowness(t, r) * own);
            work += own;
            before = after;
        }
        work *= group_slowness(t, begin, end);
        const bool together = end - begin > 1;
        const double mean = work / (end - begin), longest = together ? mean : alone;
        p.seconds =
            fmax(p.seconds, together ? fmin(t->grain * alone, mean + wait_for_batch(t, kind)) : t->grain * alone);
        p.longest = fmax(p.longest, longest);
        p.total += work;
    }
    return p;
}

/* ---- new bounds ---- */

/* A stretch of the row of cells: points and their cost. */
struct stretch {
    double begin, end, cost_begin, cost_end;
};

/* The stretch of a rank's points in which the sum of their cost reaches `wanted`. Its width is a part of a batch, the
 * finest resolution at which a bake measures cost. */
static struct stretch stretch_at(const struct state *t, uint32_t kind, uint32_t rank, double wanted)
{
    const double all = t->points[t->s->cell_count], a_second = all / t->cost[kind][t->s->cell_count];
    const double width = fmin((double)t->s->part_points / t->density, a_second * BATCH_SECONDS / t->density);
    const double begin = t->bounds[rank], end = t->bounds[rank + 1];
    double low = 0.0, high = ceil((end - begin) / width);
    while (low + 1.0 < high) {
        const double middle = floor(0.5 * (low + high));
        if (at(t, t->points, t->cost[kind], begin + middle * width) <= wanted)
            low = middle;
        else
            high = middle;
    }
    struct stretch s = {.begin = begin + low * width, .end = fmin(end, begin + (low + 1.0) * width)};
    s.cost_begin = at(t, t->points, t->cost[kind], s.begin);
    s.cost_end = at(t, t->points, t->cost[kind], s.end);
    return s;
}

/* New bound within the rank's points: where the work of all ranks, as seen in the last step, sums up to `ideal`; or the
 * nearest beginning of a cell, if the difference is within `slack`. */
static double bound_at(const struct state *t, uint32_t kind, uint32_t rank, double ideal, double slack)
{
    const uint32_t begin = group_begin(t, rank);
    const double slow = group_slowness(t, begin, group_end(t, begin));
    const double wanted = cost_before(t, kind, rank) + (ideal - t->work[rank]) / slow;
    const struct stretch s =
        t->s->part_points > 0 ? stretch_at(t, kind, rank, wanted) : (struct stretch){0.0, 0.0, 0.0, 0.0};
    const double width = s.end - s.begin, a_point = width > 0.0 ? (s.cost_end - s.cost_begin) / width : 0.0;
    const double bound = a_point > 0.0 ? fmin(s.end, s.begin + (wanted - s.cost_begin) / a_point)
                                       : at(t, t->cost[kind], t->points, wanted);
    const size_t cell = cell_at(t, t->points, bound),
                 near = bound - t->points[cell] < t->points[cell + 1] - bound ? cell : cell + 1;
    const double off =
        fabs(at(t, t->points, t->cost[kind], t->points[near]) - at(t, t->points, t->cost[kind], bound)) * slow;
    return off <= slack && t->points[near] > t->bounds[rank] && t->points[near] < t->bounds[rank + 1] ? t->points[near]
                                                                                                      : bound;
}

static void make_bounds(struct state *t, uint32_t kind)
{
    for (uint32_t r = 0; r < t->ranks; r++) {
        const uint32_t begin = group_begin(t, r);
        t->work[r + 1] = t->work[r] + group_slowness(t, begin, group_end(t, begin)) *
                                          (cost_before(t, kind, r + 1) - cost_before(t, kind, r));
    }
    const double total = t->work[t->ranks];
    uint32_t rank = 0;
    t->next[0] = 0.0;
    t->next[t->ranks] = t->bounds[t->ranks];
    for (uint32_t k = 1; k < t->ranks; k++) {
        const double ideal = total * k / t->ranks;
        while (rank + 1 < t->ranks && t->work[rank + 1] <= ideal)
            rank++;
        t->next[k] = fmax(t->next[k - 1], bound_at(t, kind, rank, ideal, KILN_BOUND_SLACK * total / t->ranks));
    }
}

/* Largest number of points that a group of `together` neighbouring ranks receives from others. */
static double most_moved(const struct state *t, uint32_t together)
{
    double most = 0.0;
    for (uint32_t r = 0, end; r < t->ranks; r = end) {
        end = t->ranks - r > together ? r + together : t->ranks;
        const double kept = fmin(t->bounds[end], t->next[end]) - fmax(t->bounds[r], t->next[r]);
        most = fmax(most, t->next[end] - t->next[r] - fmax(0.0, kept));
    }
    return most * t->density;
}

/* Redistributes the points if a bake would do so between the two steps. */
static void consider(struct state *t, const struct kiln_planned_step *last, const struct kiln_planned_step *next,
                     const struct shown *shown, struct kiln_simulated_light *light)
{
    const struct kiln_light_simulation *s = t->s;
    const enum kiln_rebalance mode = s->settings->rebalance;
    const struct kiln_repartition_steps steps = {last->step, next->step, next->outlook};
    if (t->ranks == 1 || !(shown->total > 0.0) || !kiln_repartition_is_allowed(mode, s->keeps_points) ||
        !kiln_repartition_is_due(mode, &steps))
        return;
    const double gain = kiln_repartition_gain(&steps, shown->longest, shown->total / t->ranks);
    if (!kiln_repartition_is_asked(mode, gain))
        return;
    make_bounds(t, last->kind);
    const double moved = most_moved(t, 1), cost = kiln_repartition_cost(moved, s->moved_bytes);
    if (!(moved >= 1.0) || !kiln_repartition_pays(mode, gain, cost))
        return;
    light->move += fmax(cost, most_moved(t, ranks_of_node(t)) * s->moved_bytes / s->bandwidth + s->latency);
    light->repartitions++;
    double *bounds = t->bounds;
    t->bounds = t->next;
    t->next = bounds;
    light->points_most = fmax(light->points_most, most_points(t));
}

/* ---- the trial before the first step (integrate/run/trial.h) ---- */

/* Simulates the trial, which lasts as long as its slowest rank, and redistributes points by the costs that it finds. */
static void run_trial(struct state *t, const struct kiln_planned_step *first, struct kiln_simulated_light *light)
{
    const struct kiln_light_simulation *s = t->s;
    const uint32_t group = group_end(t, 0);
    const double points = t->density * t->points[s->cell_count] / t->ranks,
                 tile_runs = fmax(1.0, (double)s->tile_runs * t->density),
                 tile_run = t->density * t->points[s->cell_count] / tile_runs;
    if (group == t->ranks || !kiln_repartition_is_allowed(s->settings->rebalance, s->keeps_points) ||
        !kiln_trial_is_due(s->settings->rebalance, &first->step, (uint64_t)points))
        return;
    const struct shown shown = run_step(t, first->kind);
    const double tried =
        fmin(1.0, fmax(KILN_TRIAL_TILE_RUNS, s->threads) * tile_run / fmin(points, KILN_TRIAL_STRETCH));
    double longest = 0.0;
    for (uint32_t r = 0; r < t->ranks; r++)
        longest = fmax(longest, slowness(t, r) * t->density *
                                    (cost_before(t, first->kind, r + 1) - cost_before(t, first->kind, r)));
    light->seconds[first->step.role] += tried * longest;
    light->trial = tried * longest;
    consider(t, first, first, &shown, light);
}

/* ---- the bake ---- */

static double over_mean(double seconds, double mean) { return mean > 0.0 ? seconds / mean - 1.0 : 0.0; }

static void run_bake(struct state *t, struct kiln_simulated_light *light)
{
    const struct kiln_light_simulation *s = t->s;
    struct shown kept[KILN_COST_KINDS_MAX], shown = {0.0, 0.0, 0.0};
    double seconds = 0.0, mean = 0.0, kept_seconds = 0.0, kept_mean = 0.0;
    t->helps = false;
    for (uint32_t k = 0; k < s->steps->kind_count; k++)
        kept[k] = run_step(t, k);
    t->helps = s->computes_for_others && s->settings->work_stealing;
    if (s->steps->count > 0)
        run_trial(t, &s->steps->of[0], light);
    for (size_t i = 0; i < s->steps->count; i++) {
        const struct kiln_planned_step *planned = &s->steps->of[i];
        const uint32_t role = planned->step.role;
        if (i > 0)
            consider(t, planned - 1, planned, &shown, light);
        shown = run_step(t, planned->kind);
        light->seconds[role] += shown.seconds;
        light->last[role] = over_mean(shown.longest, shown.total / t->ranks);
        if (i == 0 || role != planned[-1].step.role)
            light->first[role] = light->last[role];
        seconds += shown.seconds;
        mean += shown.total / t->ranks;
        kept_seconds += kept[planned->kind].seconds;
        kept_mean += kept[planned->kind].total / t->ranks;
    }
    light->imbalance = over_mean(seconds + light->trial, mean);
    light->kept = over_mean(kept_seconds, kept_mean);
}

int kiln_simulate_light(const struct kiln_light_simulation *s, uint32_t ranks, double density,
                        struct kiln_simulated_light *light, struct kiln_error *error)
{
    struct state t = {.s = s, .ranks = ranks, .density = density};
    *light = (struct kiln_simulated_light){.move = 0.0};
    if (s->cell_count == 0)
        return KILN_OK;
    int status = make_cells(&t, error);
    double **const arrays[] = {&t.bounds, &t.next, &t.work};
    KILN_TRY(status);
    for (size_t i = 0; i < sizeof arrays / sizeof *arrays; i++)
        KILN_TRY(kiln_allocate(arrays[i], (size_t)ranks + 1, sizeof **arrays[i], "the simulated ranks", error));
    KILN_TRY(first_bounds(&t, error));
    light->points_most = most_points(&t);
    run_bake(&t, light);
end:
    for (size_t i = 0; i < sizeof arrays / sizeof *arrays; i++)
        kiln_free(arrays[i]);
    for (uint32_t l = 0; l < KILN_COST_KINDS_MAX; l++)
        kiln_free(&t.cost[l]);
    kiln_free(&t.points);
    return status;
}
