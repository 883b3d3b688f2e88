#include "coordinator/surface/build.h"
#include "worker/base/memory.h"

/* Where the ranks' ranges begin in the global order: ranks + 1 entries of each. */
struct rank_bounds {
    uint64_t *all; /* one allocation: the tile_run entries, then the point entries */
    uint64_t *tile_run, *point;
};

static uint64_t most_points(const struct kiln_build *build, const struct rank_bounds *bounds)
{
    uint64_t most = 0;
    for (uint32_t r = 0; r < build->params->ranks; r++) {
        const uint64_t points = bounds->point[r + 1] - bounds->point[r];
        most = points > most ? points : most;
    }
    return most;
}

static void report_balance(struct kiln_build *build, const struct rank_bounds *bounds)
{
    struct kiln_surface_report *report = build->report;
    const uint32_t ranks = build->params->ranks;
    report->points_min = UINT64_MAX;
    for (uint32_t r = 0; r < ranks; r++) {
        const uint64_t points = bounds->point[r + 1] - bounds->point[r];
        report->points_min = points < report->points_min ? points : report->points_min;
    }
    report->points_max = most_points(build, bounds);
    if (build->surface->point_count > 0)
        report->imbalance = (double)report->points_max / ((double)build->surface->point_count / ranks) - 1.0;
}

/* Splits the global order between units. Returns whether the ranks' numbers of points are equal enough. `unit_bounds`:
 * room for ranks + 1. */
static bool split_between_units(const struct kiln_build *build, const struct rank_bounds *bounds, uint64_t *unit_bounds)
{
    const struct kiln_units *units = &build->units;
    const uint32_t ranks = build->params->ranks;
    kiln_partition_cut(units->points, units->count, ranks, unit_bounds);
    for (uint32_t r = 0; r <= ranks; r++) {
        bounds->tile_run[r] = units->first_tile_run[unit_bounds[r]];
        bounds->point[r] = units->first_point[unit_bounds[r]];
    }
    const uint64_t points = build->surface->point_count;
    return ranks == 1 || points == 0 ||
           (units->count >= ranks &&
            (double)most_points(build, bounds) <= (1.0 + KILN_PARTITION_IMBALANCE) * ((double)points / ranks));
}

/* The first rank whose range should begin beyond `point`. */
static uint32_t first_rank_beyond(const struct kiln_build *build, uint64_t point)
{
    uint32_t low = 0, high = build->params->ranks;
    while (low < high) {
        const uint32_t middle = low + (high - low) / 2;
        if (kiln_partition_ideal(build->surface->point_count, build->params->ranks, middle) > point)
            high = middle;
        else
            low = middle + 1;
    }
    return low;
}

/* Splits the global order between tile runs, as kiln_partition_cut would do with the list of all tile runs. No rank has
 * this list. The rank that found the tile run at a border chooses its nearer end; a sum over the ranks, to which all
 * others add 0, tells it to all. */
static int split_between_tile_runs(struct kiln_build *build, const struct rank_bounds *bounds)
{
    const struct kiln_surface_exchange *x = build->exchange;
    const uint32_t ranks = build->params->ranks;
    const uint64_t points = build->surface->point_count;
    for (uint32_t r = 0; r <= ranks; r++)
        bounds->tile_run[r] = bounds->point[r] = 0;
    for (uint64_t b = build->own_first; b < build->own_end; b++) {
        for (size_t i = 0; i < build->tile_ranges[b].count; i++) {
            const struct kiln_unplaced_run *run = &build->tile_ranges[b].runs[i];
            const uint64_t end = run->first + kiln_unplaced_run_points(run);
            for (uint32_t r = first_rank_beyond(build, run->first); r < ranks; r++) {
                const uint64_t ideal = kiln_partition_ideal(points, ranks, r);
                if (ideal > end)
                    break;
                const bool before = end - ideal >= ideal - run->first;
                bounds->tile_run[r] = run->position + (before ? 0 : 1);
                bounds->point[r] = before ? run->first : end;
            }
        }
    }
    const int status = x->sum(x->context, KILN_OK, bounds->all, NULL, 2 * ((size_t)ranks + 1), build->error);
    bounds->tile_run[ranks] = build->report->tile_runs;
    bounds->point[ranks] = points;
    return status;
}

static int choose_bounds(struct kiln_build *build, struct rank_bounds *bounds)
{
    const struct kiln_surface_exchange *x = build->exchange;
    const size_t count = (size_t)build->params->ranks + 1;
    uint64_t *unit_bounds = NULL;
    int status = kiln_allocate(&bounds->all, 2 * count, sizeof *bounds->all, "the partition", build->error);
    if (status == KILN_OK)
        status = kiln_allocate(&unit_bounds, count, sizeof *unit_bounds, "the partition", build->error);
    status = x->agree(x->context, status, build->error);
    if (status == KILN_OK) {
        bounds->tile_run = bounds->all;
        bounds->point = bounds->all + count;
        status = split_between_units(build, bounds, unit_bounds) ? KILN_OK : split_between_tile_runs(build, bounds);
    }
    if (status == KILN_OK)
        report_balance(build, bounds);
    kiln_free(&unit_bounds);
    return status;
}

/* A tile run with its position, as sent to its owner. */
struct placed_run {
    struct kiln_tile_run tile_run;
    uint64_t position;
    uint32_t pieces, cdf_entries;
};

static struct placed_run place_run(const struct kiln_tile_range *tile_range, const struct kiln_unplaced_run *run)
{
    return (struct placed_run){.tile_run = {.first = {run->first},
                                            .mask = run->mask,
                                            .map = tile_range->map,
                                            .tile = run->tile,
                                            .cell = run->cell,
                                            .count = (uint32_t)kiln_unplaced_run_points(run)},
                               .position = run->position,
                               .pieces = run->pieces,
                               .cdf_entries = run->cdf_entries};
}

struct receiver {
    struct kiln_surface *surface;
    uint64_t position; /* of this rank's first tile run, in the global order */
};

/* kiln_surface_taker, of struct receiver */
static void receive_runs(void *taker, const void *records, size_t count)
{
    const struct receiver *receiver = taker;
    const struct placed_run *runs = records;
    for (size_t i = 0; i < count; i++) {
        const uint64_t f = runs[i].position - receiver->position;
        receiver->surface->tile_runs[f] = runs[i].tile_run;
        receiver->surface->piece_base[f + 1] = runs[i].pieces;
        receiver->surface->area_cdf_base[f + 1] = runs[i].cdf_entries;
    }
}

/* The rank whose range holds the tile run at `position`. Ranges may be empty. */
static uint32_t owner_of(const struct kiln_build *build, const struct rank_bounds *bounds, uint64_t position)
{
    uint32_t low = 0, high = build->params->ranks;
    while (high - low > 1) {
        const uint32_t middle = low + (high - low) / 2;
        if (bounds->tile_run[middle] <= position)
            low = middle;
        else
            high = middle;
    }
    return low;
}

/* The tile runs to send, by destination rank. */
struct send_buffer {
    struct placed_run *runs;
    size_t *counts, *place; /* per rank: how many are for it; where its next one goes */
};

/* Stores the tile runs that this rank found for itself; counts those of each other rank. Returns the sum of these
 * counts. */
static size_t keep_own_runs(const struct kiln_build *build, const struct rank_bounds *bounds, struct receiver *receiver,
                            size_t *counts)
{
    size_t others = 0;
    for (uint64_t b = build->own_first; b < build->own_end; b++) {
        for (size_t i = 0; i < build->tile_ranges[b].count; i++) {
            const struct kiln_unplaced_run *run = &build->tile_ranges[b].runs[i];
            const uint32_t owner = owner_of(build, bounds, run->position);
            if (owner == build->params->rank) {
                const struct placed_run own = place_run(&build->tile_ranges[b], run);
                receive_runs(receiver, &own, 1);
            } else {
                counts[owner]++;
                others++;
            }
        }
    }
    return others;
}

static void fill_send_buffer(const struct kiln_build *build, const struct rank_bounds *bounds,
                             struct send_buffer *buffer)
{
    for (uint32_t r = 1; r < build->params->ranks; r++)
        buffer->place[r] = buffer->place[r - 1] + buffer->counts[r - 1];
    for (uint64_t b = build->own_first; b < build->own_end; b++) {
        for (size_t i = 0; i < build->tile_ranges[b].count; i++) {
            const struct kiln_unplaced_run *run = &build->tile_ranges[b].runs[i];
            const uint32_t owner = owner_of(build, bounds, run->position);
            if (owner != build->params->rank)
                buffer->runs[buffer->place[owner]++] = place_run(&build->tile_ranges[b], run);
        }
    }
}

static int exchange_runs(struct kiln_build *build, const struct rank_bounds *bounds, int status)
{
    const struct kiln_surface_exchange *x = build->exchange;
    const uint32_t ranks = build->params->ranks;
    const char *what = "the tile runs to send";
    struct receiver receiver = {build->surface, bounds->tile_run[build->params->rank]};
    struct send_buffer buffer = {0};
    if (status == KILN_OK)
        status = kiln_allocate(&buffer.counts, ranks, sizeof *buffer.counts, what, build->error);
    if (status == KILN_OK)
        status = kiln_allocate(&buffer.place, ranks, sizeof *buffer.place, what, build->error);
    if (status == KILN_OK) {
        const size_t others = keep_own_runs(build, bounds, &receiver, buffer.counts);
        if (build->workers > 1)
            status = kiln_allocate(&buffer.runs, others, sizeof *buffer.runs, what, build->error);
    }
    if (buffer.runs != NULL)
        fill_send_buffer(build, bounds, &buffer);
    status = x->alltoall(x->context, status, buffer.runs, buffer.counts, sizeof *buffer.runs, receive_runs, &receiver,
                         build->error);
    kiln_free(&buffer.runs);
    kiln_free(&buffer.counts);
    kiln_free(&buffer.place);
    return status;
}

static int receive_tile_runs(struct kiln_build *build, const struct rank_bounds *bounds)
{
    struct kiln_surface *s = build->surface;
    const uint32_t rank = build->params->rank;
    s->first.at = bounds->point[rank];
    s->count = bounds->point[rank + 1] - s->first.at;
    s->tile_run_count = bounds->tile_run[rank + 1] - bounds->tile_run[rank];
    int status;
    KILN_TRY(kiln_allocate(&s->tile_runs, s->tile_run_count, sizeof *s->tile_runs, "the tile runs", build->error));
    KILN_TRY(
        kiln_allocate(&s->piece_base, s->tile_run_count + 1, sizeof *s->piece_base, "the tile runs", build->error));
    KILN_TRY(kiln_allocate(&s->area_cdf_base, s->tile_run_count + 1, sizeof *s->area_cdf_base, "the tile runs",
                           build->error));
end:
    status = exchange_runs(build, bounds, status);
    for (size_t f = 0; f < s->tile_run_count && status == KILN_OK; f++) {
        s->piece_base[f + 1] += s->piece_base[f];
        s->area_cdf_base[f + 1] += s->area_cdf_base[f];
    }
    return status;
}

int kiln_build_assign(struct kiln_build *build)
{
    struct rank_bounds bounds = {0};
    int status;
    KILN_TRY(choose_bounds(build, &bounds));
    KILN_TRY(receive_tile_runs(build, &bounds));
    if (build->params->partition == KILN_PARTITION_CELLS) {
        build->surface->cell_first = build->units.first_point;
        build->units.first_point = NULL;
    }
end:
    kiln_free(&bounds.all);
    return status;
}
