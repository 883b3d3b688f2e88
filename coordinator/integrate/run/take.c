#include "coordinator/integrate/run/take.h"

#include <assert.h>

#include "coordinator/integrate/company.h"
#include "coordinator/integrate/quantity.h"
#include "worker/base/memory.h"

/* Most points that one thread takes over alone, because waking others would take longer. If tiles have ended, results
 * come in thousands of short ranges. */
enum { POINTS_ALONE = 1 << 11 };
/* Tile runs that a thread takes over one after the other: those that are left out lie together. */
enum { TOGETHER = 32 };

static void take_one(const struct kiln_taking *t, const struct kiln_rank_data *data,
                     const struct kiln_tile_run *tile_run, const void *results, struct kiln_tally *tally,
                     struct kiln_tile_run_tally *tile_run_tally)
{
    if (t->step->quantity != NULL)
        t->step->quantity->take(t, data, tile_run, results);
    else
        t->settings->integrator->take(t, data, tile_run, results, tally, tile_run_tally);
}

/* Whether an answer of the tile run was computed without some radiosity. */
static bool lacks(const struct kiln_pass *pass, const struct kiln_tile_run *tile_run, const char *results)
{
    uint32_t any = 0;
    for (uint32_t i = 0; i < tile_run->count; i++)
        any |= pass->lacks(results + i * pass->result_bytes);
    return any != 0;
}

/* Source of answers: memory, or a function. */
struct answers {
    const uint32_t *samples; /* of tile runs; one with 0 has no answers. NULL: all have some */
    const char *results;     /* NULL: `give` gives them */
    kiln_give_results give;
    void *context;
};

/* Takes the tile run `first` + `i`. */
static void take_tile_run(const struct kiln_taker *taker, const struct kiln_rank_data *data, size_t first, size_t i,
                          const struct answers *from, struct kiln_tally *tally)
{
    const struct kiln_taking *taking = &taker->taking;
    const struct kiln_tile_run *begin = &data->surface.tile_runs[first], *f = begin + i;
    const size_t bytes = taking->step->pass->result_bytes;
    taker->tile_runs[i] = (struct kiln_tile_run_tally){0};
    if (from->samples != NULL && from->samples[i] == 0)
        return;
    struct kiln_point_result given[KILN_TILE_TEXELS];
    const char *answers = from->results != NULL ? from->results + (f->first.at - begin->first.at) * bytes : NULL;
    if (answers == NULL) {
        from->give(from->context, taking->step, first + i, 1, given);
        answers = (const char *)given;
    }
    if (taker->may_lack && lacks(taking->step->pass, f, answers)) {
        data->lacking[first + i] = 1;
        return;
    }
    take_one(taking, data, f, answers, tally, &taker->tile_runs[i]);
    kiln_company_take(taker->company, taking, data, f, answers);
}

static int take(struct kiln_taker *taker, const struct kiln_rank_data *data, size_t first, size_t count,
                const struct answers *from, struct kiln_error *error)
{
    const struct kiln_tile_run *tile_runs = data->surface.tile_runs + first;
    const int status =
        kiln_grow(&taker->tile_runs, &taker->tile_run_room, count, sizeof *taker->tile_runs, "a part's sums", error);
    if (status != KILN_OK)
        return status;
    const bool alone = count == 0 || kiln_tile_runs_points(tile_runs, tile_runs + count - 1) <= POINTS_ALONE;
#pragma omp parallel num_threads((int)taker->threads) if (!alone)
    {
        struct kiln_tally own = {0};
#pragma omp for schedule(static, TOGETHER)
        for (size_t i = 0; i < count; i++)
            take_tile_run(taker, data, first, i, from, &own);
#pragma omp critical(kiln_taker_take)
        kiln_ledger_add(taker->ledger, &own); /* sums are exact, so the order of threads does not matter */
    }
    for (size_t i = 0; i < count; i++)
        if (from->samples == NULL || from->samples[i] > 0)
            kiln_ledger_add_tile_run(taker->ledger, &data->surface, &tile_runs[i], &taker->tile_runs[i]);
    return KILN_OK;
}

int kiln_taker_take(struct kiln_taker *taker, const struct kiln_rank_data *data, size_t first, size_t count,
                    const uint32_t *samples, const void *results, struct kiln_error *error)
{
    const struct answers from = {.samples = samples, .results = results};
    return take(taker, data, first, count, &from, error);
}

int kiln_taker_take_given(struct kiln_taker *taker, const struct kiln_rank_data *data, size_t first, size_t count,
                          kiln_give_results give, void *context, struct kiln_error *error)
{
    const struct answers from = {.give = give, .context = context};
    assert(taker->taking.step->pass->result_bytes == sizeof(struct kiln_point_result));
    return take(taker, data, first, count, &from, error);
}

void kiln_taker_release(struct kiln_taker *taker) { kiln_free(&taker->tile_runs); }
