#include "coordinator/bake/simulate.h"

#include <math.h>

#include "coordinator/surface/surface_build.h"
#include "worker/base/memory.h"

static const double NODE_MEMORY_BANDWIDTH = 10e9; /* bytes a second that ranks of one node hand over */
static const double WHOLE_CELLS = 0.1;            /* as the partition: cells stay whole up to so much imbalance */

/* Points and cost of all cells before each one, and after the last. */
struct sums {
    double *points, *cost;
};

static int make_sums(struct sums *sums, const struct kiln_simulation *s, struct kiln_error *error)
{
    int status = kiln_allocate(&sums->points, s->cell_count + 1, sizeof(double), "the simulated cells", error);
    if (status == KILN_OK)
        status = kiln_allocate(&sums->cost, s->cell_count + 1, sizeof(double), "the simulated cells", error);
    for (size_t i = 0; status == KILN_OK && i < s->cell_count; i++) {
        sums->points[i + 1] = sums->points[i] + (double)s->cell_points[i];
        sums->cost[i + 1] = sums->cost[i] + (double)s->cell_points[i] * s->cell_cost[i];
    }
    return status;
}

/* Cost of the first `points` points. */
static double cost_until(const struct sums *sums, size_t cells, double points)
{
    size_t low = 0, high = cells;
    while (low + 1 < high) {
        const size_t middle = (low + high) / 2;
        if (sums->points[middle] <= points)
            low = middle;
        else
            high = middle;
    }
    const double width = sums->points[low + 1] - sums->points[low];
    const double part = width > 0.0 ? fmin(1.0, (points - sums->points[low]) / width) : 0.0;
    return sums->cost[low] + part * (sums->cost[low + 1] - sums->cost[low]);
}

/* Largest share of the cost when cells stay whole; *points: of the points. */
static double largest_of_cells(const struct sums *sums, uint32_t ranks, const uint64_t *cuts, double *points)
{
    double most = 0.0;
    *points = 0.0;
    for (uint32_t r = 0; r < ranks; r++) {
        most = fmax(most, sums->cost[cuts[r + 1]] - sums->cost[cuts[r]]);
        *points = fmax(*points, sums->points[cuts[r + 1]] - sums->points[cuts[r]]);
    }
    return most;
}

/* Largest share when fragments are dealt out: equal points, up to one fragment more than the mean. */
static double largest_of_fragments(const struct kiln_simulation *s, const struct sums *sums, uint32_t ranks, double density)
{
    const double all = sums->points[s->cell_count], each = all / ranks, fragments = fmax(1.0, (double)s->fragments * density) / ranks;
    double most = 0.0;
    for (uint32_t r = 0; r < ranks; r++)
        most = fmax(most, cost_until(sums, s->cell_count, each * (r + 1.0)) - cost_until(sums, s->cell_count, each * r));
    return most * ceil(fragments) / fragments;
}

static int largest_share(const struct kiln_simulation *s, const struct sums *sums, uint32_t ranks, double density, double *largest,
                         struct kiln_error *error)
{
    uint64_t *cuts = NULL;
    double points = INFINITY;
    int status = KILN_OK;
    if (ranks <= s->cell_count) {
        status = kiln_allocate(&cuts, (size_t)ranks + 1, sizeof *cuts, "the simulated ranks", error);
        if (status == KILN_OK) {
            kiln_partition_cut(s->cell_points, s->cell_count, ranks, cuts);
            *largest = largest_of_cells(sums, ranks, cuts, &points);
        }
    }
    if (status == KILN_OK && points > (1.0 + WHOLE_CELLS) * sums->points[s->cell_count] / ranks)
        *largest = largest_of_fragments(s, sums, ranks, density);
    kiln_free(&cuts);
    return status;
}

double kiln_exchange_seconds(double bytes, uint32_t ranks, uint32_t nodes, double bandwidth, double latency)
{
    if (nodes > 1)
        return bytes * (nodes - 1.0) / nodes / bandwidth + ceil(log2(nodes)) * latency;
    return ranks > 1 ? bytes / NODE_MEMORY_BANDWIDTH : 0.0;
}

/* Seconds until all know where the points lie: every rank of a node is told. */
static double find_seconds(const struct kiln_simulation *s, const struct kiln_scaled *scaled, uint32_t together)
{
    const double share = s->find_a_point * scaled->points / scaled->ranks, map = scaled->ranks > 1 ? s->map_a_point * scaled->points : 0.0;
    return share + map + kiln_exchange_seconds(s->map_bytes * scaled->points * together, scaled->ranks, scaled->nodes, s->bandwidth, s->latency);
}

/* Packing is divided; what one rank does alone comes on top of it, as if nothing of it could go on at the same time. */
static double write_seconds(const struct kiln_simulation *s, const struct kiln_scaled *scaled, double density)
{
    const double alone = s->largest_object * density + s->alone_a_point * scaled->points;
    return s->shared_a_point * scaled->points / scaled->ranks + (scaled->ranks > 1 ? alone : 0.0);
}

int kiln_simulate(const struct kiln_simulation *s, uint32_t ranks, double density, struct kiln_scaled *scaled, struct kiln_error *error)
{
    struct sums sums = {0};
    const uint32_t together = s->ranks_per_node > 0 ? s->ranks_per_node : 1;
    double largest = 0.0;
    *scaled = (struct kiln_scaled){.ranks = ranks, .nodes = (ranks + together - 1) / together};
    int status = make_sums(&sums, s, error);
    if (status == KILN_OK && s->cell_count > 0)
        status = largest_share(s, &sums, ranks, density, &largest, error);
    if (status == KILN_OK) {
        const double mean = sums.cost[s->cell_count] / ranks;
        scaled->points = sums.points[s->cell_count] * density;
        scaled->trace = largest * density + s->shared / ranks;
        scaled->imbalance = mean > 0.0 ? largest / mean - 1.0 : 0.0;
        scaled->exchange = s->exchanges * kiln_exchange_seconds(s->radiosity_bytes * scaled->points, ranks, scaled->nodes, s->bandwidth, s->latency);
        scaled->find = find_seconds(s, scaled, together < ranks ? together : ranks);
        scaled->once = s->once;
        scaled->write = write_seconds(s, scaled, density);
        scaled->seconds = scaled->trace + scaled->exchange + scaled->find + scaled->once + scaled->write;
    }
    kiln_free(&sums.points);
    kiln_free(&sums.cost);
    return status;
}

/* Against the first entry; `work` is how much more there is to do than there. */
static void rate(const struct kiln_scaled *first, struct kiln_scaled *scaled, double work)
{
    const double ideal = work / scaled->ranks;
    scaled->efficiency = scaled->seconds > 0.0 ? ideal * first->seconds / scaled->seconds : 1.0;
    const double traced = scaled->trace + scaled->exchange;
    scaled->trace_efficiency = traced > 0.0 ? ideal * (first->trace + first->exchange) / traced : 1.0;
}

int kiln_simulate_curves(const struct kiln_simulation *s, uint32_t most, struct kiln_scaled *strong, struct kiln_scaled *weak, size_t *count,
                         struct kiln_error *error)
{
    int status = KILN_OK;
    *count = 0;
    for (uint32_t ranks = 1; status == KILN_OK && *count < KILN_CURVE_MAX; ranks = ranks > most / 2 ? most : 2 * ranks) {
        const size_t i = *count;
        status = kiln_simulate(s, ranks, s->density, &strong[i], error);
        if (status == KILN_OK)
            status = kiln_simulate(s, ranks, s->density * ranks, &weak[i], error);
        rate(&strong[0], &strong[i], 1.0);
        rate(&weak[0], &weak[i], ranks);
        ++*count;
        if (ranks >= most)
            break;
    }
    return status;
}
