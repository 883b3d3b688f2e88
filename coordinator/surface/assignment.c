#include "coordinator/surface/build.h"
#include "worker/base/memory.h"

static const double MOST_IMBALANCE = 0.1; /* units stay whole up to so much */

/* Where the shares begin in global order: ranks + 1 of each. */
struct borders {
    uint64_t *all; /* tile runs, then points */
    uint64_t *tile_run, *point;
};

static uint64_t largest_share(const struct kiln_build *build, const struct borders *borders)
{
    uint64_t most = 0;
    for (uint32_t r = 0; r < build->params->ranks; r++) {
        const uint64_t share = borders->point[r + 1] - borders->point[r];
        most = share > most ? share : most;
    }
    return most;
}

static void report_balance(struct kiln_build *build, const struct borders *borders)
{
    struct kiln_surface_report *report = build->report;
    const uint32_t ranks = build->params->ranks;
    report->points_min = UINT64_MAX;
    for (uint32_t r = 0; r < ranks; r++) {
        const uint64_t share = borders->point[r + 1] - borders->point[r];
        report->points_min = share < report->points_min ? share : report->points_min;
    }
    report->points_max = largest_share(build, borders);
    if (build->surface->point_count > 0)
        report->imbalance = (double)report->points_max / ((double)build->surface->point_count / ranks) - 1.0;
}

/* Cuts between units. Whether the shares are equal enough. `cuts`: room for ranks + 1. */
static bool cut_units(const struct kiln_build *build, const struct borders *borders, uint64_t *cuts)
{
    const struct kiln_units *units = &build->units;
    const uint32_t ranks = build->params->ranks;
    kiln_partition_cut(units->points, units->count, ranks, cuts);
    for (uint32_t r = 0; r <= ranks; r++) {
        borders->tile_run[r] = units->first_tile_run[cuts[r]];
        borders->point[r] = units->first_point[cuts[r]];
    }
    const uint64_t points = build->surface->point_count;
    return ranks == 1 || points == 0 ||
           (units->count >= ranks &&
            (double)largest_share(build, borders) <= (1.0 + MOST_IMBALANCE) * ((double)points / ranks));
}

/* The first share whose border should lie beyond `point`. */
static uint32_t share_beyond(const struct kiln_build *build, uint64_t point)
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

/* Cuts between tile runs as kiln_partition_cut would, had anybody a list of them all: who found the tile run in which a
 * border should lie says which of its ends is nearer. */
static int cut_tile_runs(struct kiln_build *build, const struct borders *borders)
{
    const struct kiln_surface_exchange *x = build->exchange;
    const uint32_t ranks = build->params->ranks;
    const uint64_t points = build->surface->point_count;
    for (uint32_t r = 0; r <= ranks; r++)
        borders->tile_run[r] = borders->point[r] = 0;
    for (uint64_t b = build->own_first; b < build->own_end; b++) {
        for (size_t i = 0; i < build->blocks[b].count; i++) {
            const struct kiln_part *part = &build->blocks[b].parts[i];
            const uint64_t end = part->first + kiln_part_points(part);
            for (uint32_t r = share_beyond(build, part->first); r < ranks; r++) {
                const uint64_t ideal = kiln_partition_ideal(points, ranks, r);
                if (ideal > end)
                    break;
                const bool before = end - ideal >= ideal - part->first;
                borders->tile_run[r] = part->position + (before ? 0 : 1);
                borders->point[r] = before ? part->first : end;
            }
        }
    }
    const int status = x->sum(x->context, KILN_OK, borders->all, NULL, 2 * ((size_t)ranks + 1), build->error);
    borders->tile_run[ranks] = build->report->tile_runs;
    borders->point[ranks] = points;
    return status;
}

static int cut_shares(struct kiln_build *build, struct borders *borders)
{
    const struct kiln_surface_exchange *x = build->exchange;
    const size_t count = (size_t)build->params->ranks + 1;
    uint64_t *cuts = NULL;
    int status = kiln_allocate(&borders->all, 2 * count, sizeof *borders->all, "the partition", build->error);
    if (status == KILN_OK)
        status = kiln_allocate(&cuts, count, sizeof *cuts, "the partition", build->error);
    status = x->agree(x->context, status, build->error);
    if (status == KILN_OK) {
        borders->tile_run = borders->all;
        borders->point = borders->all + count;
        status = cut_units(build, borders, cuts) ? KILN_OK : cut_tile_runs(build, borders);
    }
    if (status == KILN_OK)
        report_balance(build, borders);
    kiln_free(&cuts);
    return status;
}

/* A tile run on its way to its owner. */
struct parcel {
    struct kiln_tile_run tile_run;
    uint64_t position;
    uint32_t pieces, shares;
};

static struct parcel pack(const struct kiln_block *block, const struct kiln_part *part)
{
    return (struct parcel){.tile_run = {.first = part->first,
                                        .mask = part->mask,
                                        .map = block->map,
                                        .tile = part->tile,
                                        .cell = part->cell,
                                        .count = (uint32_t)kiln_part_points(part)},
                           .position = part->position,
                           .pieces = part->pieces,
                           .shares = part->shares};
}

struct receiver {
    struct kiln_surface *surface;
    uint64_t position; /* of its first tile run */
};

/* kiln_surface_taker, of struct receiver */
static void take_parcels(void *taker, const void *records, size_t count)
{
    const struct receiver *receiver = taker;
    const struct parcel *parcels = records;
    for (size_t i = 0; i < count; i++) {
        const uint64_t f = parcels[i].position - receiver->position;
        receiver->surface->tile_runs[f] = parcels[i].tile_run;
        receiver->surface->piece_base[f + 1] = parcels[i].pieces;
        receiver->surface->area_cdf_base[f + 1] = parcels[i].shares;
    }
}

/* The share that a tile run is of; shares may be empty. */
static uint32_t owner_of(const struct kiln_build *build, const struct borders *borders, uint64_t position)
{
    uint32_t low = 0, high = build->params->ranks;
    while (high - low > 1) {
        const uint32_t middle = low + (high - low) / 2;
        if (borders->tile_run[middle] <= position)
            low = middle;
        else
            high = middle;
    }
    return low;
}

/* Parcels for others, by rank. */
struct mail {
    struct parcel *parcels;
    size_t *counts, *place; /* ranks of each */
};

/* Takes own tile runs from own parts and counts the other ranks'. */
static size_t sort_parts(const struct kiln_build *build, const struct borders *borders, struct receiver *receiver,
                         size_t *counts)
{
    size_t others = 0;
    for (uint64_t b = build->own_first; b < build->own_end; b++) {
        for (size_t i = 0; i < build->blocks[b].count; i++) {
            const struct kiln_part *part = &build->blocks[b].parts[i];
            const uint32_t owner = owner_of(build, borders, part->position);
            if (owner == build->params->rank) {
                const struct parcel own = pack(&build->blocks[b], part);
                take_parcels(receiver, &own, 1);
            } else {
                counts[owner]++;
                others++;
            }
        }
    }
    return others;
}

static void fill_parcels(const struct kiln_build *build, const struct borders *borders, struct mail *mail)
{
    for (uint32_t r = 1; r < build->params->ranks; r++)
        mail->place[r] = mail->place[r - 1] + mail->counts[r - 1];
    for (uint64_t b = build->own_first; b < build->own_end; b++) {
        for (size_t i = 0; i < build->blocks[b].count; i++) {
            const struct kiln_part *part = &build->blocks[b].parts[i];
            const uint32_t owner = owner_of(build, borders, part->position);
            if (owner != build->params->rank)
                mail->parcels[mail->place[owner]++] = pack(&build->blocks[b], part);
        }
    }
}

static int send_parts(struct kiln_build *build, const struct borders *borders, int status)
{
    const struct kiln_surface_exchange *x = build->exchange;
    const uint32_t ranks = build->params->ranks;
    const char *what = "the tile runs on their way";
    struct receiver receiver = {build->surface, borders->tile_run[build->params->rank]};
    struct mail mail = {0};
    if (status == KILN_OK)
        status = kiln_allocate(&mail.counts, ranks, sizeof *mail.counts, what, build->error);
    if (status == KILN_OK)
        status = kiln_allocate(&mail.place, ranks, sizeof *mail.place, what, build->error);
    if (status == KILN_OK) {
        const size_t others = sort_parts(build, borders, &receiver, mail.counts);
        if (build->workers > 1)
            status = kiln_allocate(&mail.parcels, others, sizeof *mail.parcels, what, build->error);
    }
    if (mail.parcels != NULL)
        fill_parcels(build, borders, &mail);
    status = x->deal(x->context, status, mail.parcels, mail.counts, sizeof *mail.parcels, take_parcels, &receiver,
                     build->error);
    kiln_free(&mail.parcels);
    kiln_free(&mail.counts);
    kiln_free(&mail.place);
    return status;
}

static int take_tile_runs(struct kiln_build *build, const struct borders *borders)
{
    struct kiln_surface *s = build->surface;
    const uint32_t rank = build->params->rank;
    s->first = borders->point[rank];
    s->count = borders->point[rank + 1] - s->first;
    s->tile_run_count = borders->tile_run[rank + 1] - borders->tile_run[rank];
    int status = kiln_allocate(&s->tile_runs, s->tile_run_count, sizeof *s->tile_runs, "the tile runs", build->error);
    if (status == KILN_OK)
        status =
            kiln_allocate(&s->piece_base, s->tile_run_count + 1, sizeof *s->piece_base, "the tile runs", build->error);
    if (status == KILN_OK)
        status = kiln_allocate(&s->area_cdf_base, s->tile_run_count + 1, sizeof *s->area_cdf_base, "the tile runs",
                               build->error);
    status = send_parts(build, borders, status);
    for (size_t f = 0; f < s->tile_run_count && status == KILN_OK; f++) {
        s->piece_base[f + 1] += s->piece_base[f];
        s->area_cdf_base[f + 1] += s->area_cdf_base[f];
    }
    return status;
}

int kiln_build_deal(struct kiln_build *build)
{
    struct borders borders = {0};
    int status = cut_shares(build, &borders);
    if (status == KILN_OK)
        status = take_tile_runs(build, &borders);
    if (status == KILN_OK && build->params->partition == KILN_PARTITION_CELLS) {
        build->surface->cell_first = build->units.first_point;
        build->units.first_point = NULL;
    }
    kiln_free(&borders.all);
    return status;
}
