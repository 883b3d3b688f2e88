#include "coordinator/integrate/parts/rounds_foretold.h"

#include <math.h>
#include <string.h>

#include "coordinator/integrate/parts/published_windows.h"
#include "coordinator/integrate/parts/round_levels.h"
#include "coordinator/mpi/agree.h"
#include "worker/base/memory.h"

enum { FIRST_UNITS = 2 }; /* halves of the samples of the first round that it has */
/* Error of denoised light over that of raw light where it is judged, by the error of raw light at first: what denoises
 * well has little noise. */
#define LEAVES_OF_ONE 1.4
#define LEAVES_POWER 0.25
#define LEAVES_LEAST 0.7
#define LEAVES_MOST 1.3
#define FALLS 0.5        /* power of the samples by which errors fall */
#define WITH_SENDERS 2.0 /* samples of a round over those that tile runs take for themselves */

/* Rounds so far. */
struct foretelling {
    const struct kiln_foretell_from *from;
    const struct kiln_integrate_settings *settings;
    const struct kiln_tried_tile *tiles;
    size_t count;
    struct kiln_published published; /* of the tile runs, with their samples so far */
    double *had;                     /* by each, in halves of those of the first round */
    uint32_t *need;                  /* by each, likewise */
    uint64_t points;
    double leaves; /* denoising, of an error; 0: not known yet */
};

/* The tile runs' errors with the samples that they have had. Returns that of published light. */
static double judge(struct foretelling *f)
{
    struct kiln_published *p = &f->published;
    memset(p->numbers, 0, KILN_ERROR_BINS * sizeof *p->numbers);
    memset(p->unfinished, 0, KILN_ERROR_BINS * sizeof *p->unfinished);
    for (size_t i = 0; i < f->count; i++) {
        p->raw[i] = (float)((double)f->tiles[i].raw * pow((double)f->tiles[i].had / f->had[i], FALLS));
        p->weight[i] = f->tiles[i].weight;
        p->numbers[kiln_error_bin((double)p->raw[i])] += p->weight[i];
    }
    const double raw = kiln_published_raw_normal(p);
    if (!(f->leaves > 0.0))
        f->leaves = fmin(fmax(LEAVES_OF_ONE * pow(raw, LEAVES_POWER), LEAVES_LEAST), LEAVES_MOST);
    const bool judged = raw <= KILN_ROUND_JUDGED_WITHIN * f->settings->published_error;
    p->scale = !f->from->denoises ? 1.0 : judged ? f->leaves : KILN_ROUND_DENOISED_USUAL;
    return f->from->denoises && judged ? f->leaves * raw : raw;
}

/* Finds what tile runs need. Returns how many need more samples. */
static size_t find_needs(struct foretelling *f)
{
    const double standard = kiln_round_standard(f->settings);
    size_t left = 0;
    for (size_t i = 0; i < f->count; i++) {
        const double over = kiln_published_of(&f->published, i) / standard;
        f->need[i] = kiln_round_need(f->had[i], over * over, 0.0);
        left += f->need[i] > 0;
        if (over > 1.0)
            kiln_published_goes_on(&f->published, i);
    }
    return left;
}

/* Samples that a round of `more` halves takes, over those of the first. */
static double cost_of(const struct foretelling *f, uint64_t more)
{
    uint64_t work = 0;
    for (size_t i = 0; i < f->count; i++)
        work += (uint64_t)f->tiles[i].points * kiln_round_units(f->need[i], more);
    const double share = (double)work / ((double)more * (double)f->points);
    return fmin(WITH_SENDERS * share, 1.0) * (double)more / FIRST_UNITS;
}

static void take(struct foretelling *f, uint64_t more)
{
    for (size_t i = 0; i < f->count; i++)
        f->had[i] += kiln_round_units(f->need[i], more);
}

/* Lowers the level of a round until it takes at most `room` times the samples of the first; 0: no level does. */
static void fit(const struct foretelling *f, struct kiln_round *round, double room)
{
    while (round->to > round->from && cost_of(f, kiln_round_times(round->to) - kiln_round_times(round->from)) > room)
        round->to--;
    round->to = round->to > round->from ? round->to : 0;
}

static void go_through(struct foretelling *f, struct kiln_foretold *foretold)
{
    struct kiln_round round = {.from = f->from->level};
    for (;; round = (struct kiln_round){.from = round.to}) {
        foretold->error = judge(f);
        if (find_needs(f) == 0 || foretold->error <= f->settings->published_error)
            return;
        kiln_round_choose_published(f->settings, &f->published, &round);
        foretold->limited = round.to == 0;
        if (round.to > 0 && isfinite(f->from->most))
            fit(f, &round, f->from->most - foretold->samples);
        if (round.to == 0)
            return;
        const uint64_t more = kiln_round_times(round.to) - kiln_round_times(round.from);
        foretold->samples += cost_of(f, more);
        foretold->rounds++;
        take(f, more);
    }
}

int kiln_rounds_foretell(const struct kiln_foretell_from *from, const struct kiln_tried_tile *tiles, size_t count,
                         struct kiln_foretold *foretold, struct kiln_error *error)
{
    struct foretelling f = {
        .from = from, .settings = from->settings, .tiles = tiles, .count = count, .leaves = from->scale};
    int status;
    *foretold = (struct kiln_foretold){.tried = (uint32_t)count};
    KILN_TRY(kiln_allocate(&f.had, count, sizeof *f.had, "the rounds to come", error));
    KILN_TRY(kiln_allocate(&f.need, count, sizeof *f.need, "the rounds to come", error));
    KILN_TRY(kiln_published_allocate(&f.published, 0, count, error));
    for (size_t i = 0; i < count; i++) {
        f.had[i] = (double)tiles[i].had;
        f.points += tiles[i].points;
    }
    if (f.points > 0)
        go_through(&f, foretold);
end:
    kiln_published_release(&f.published);
    kiln_free(&f.need);
    kiln_free(&f.had);
    return status;
}

/* ---- over ranks ---- */

size_t kiln_tried_tiles_bounded(MPI_Comm communicator, size_t wanted)
{
    int ranks;
    (void)MPI_Comm_size(communicator, &ranks);
    const size_t most = KILN_TRIED_TILES_MOST / (size_t)ranks + 1;
    return wanted < most ? wanted : most;
}

int kiln_tried_tiles_gather(MPI_Comm communicator, const struct kiln_tried_tile *own, size_t count,
                            struct kiln_tried_tile **all, size_t *total, struct kiln_error *error)
{
    const int bytes = (int)(count * sizeof *own);
    int *counts = NULL, *firsts = NULL, rank, ranks, sum = 0, status;
    *all = NULL;
    *total = 0;
    (void)MPI_Comm_rank(communicator, &rank);
    (void)MPI_Comm_size(communicator, &ranks);
    KILN_TRY(kiln_allocate(&counts, (size_t)ranks, sizeof *counts, "the tried tiles", error));
    KILN_TRY(kiln_allocate(&firsts, (size_t)ranks, sizeof *firsts, "the tried tiles", error));
    if (rank == 0)
        KILN_TRY(kiln_allocate(all, KILN_TRIED_TILES_MOST + (size_t)ranks, sizeof **all, "the tried tiles", error));
end:
    status = kiln_agree(communicator, status, error);
    if (status == KILN_OK) {
        (void)MPI_Gather(&bytes, 1, MPI_INT, counts, 1, MPI_INT, 0, communicator);
        for (int r = 0; r < ranks; r++) {
            firsts[r] = sum;
            sum += counts[r];
        }
        (void)MPI_Gatherv(own, bytes, MPI_BYTE, *all, counts, firsts, MPI_BYTE, 0, communicator);
    }
    *total = (size_t)sum / sizeof *own;
    kiln_free(&counts);
    kiln_free(&firsts);
    return status;
}
