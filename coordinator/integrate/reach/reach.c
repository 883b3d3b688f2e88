#include <string.h>

#include "coordinator/integrate/companion.h"
#include "coordinator/field/radiosity_allgather.h"
#include "coordinator/run/control.h"
#include "coordinator/integrate/reach/second_go.h"
#include "coordinator/mpi/agree.h"
#include "worker/base/memory.h"

/* Companion for --visible-only: nodes receive only the radiosity that their points see (sight.h). Points whose rays
 * meet more are computed again (second_go.h). */

static bool reach_wanted(const struct kiln_integrate_params *params) { return params->settings->visible_only; }

/* Collective. From now on nodes receive only the radiosity that their points see. */
static int settle(void **self, const struct kiln_companion_site *site, struct kiln_error *error)
{
    const struct kiln_integrate_params *p = site->params;
    struct kiln_solution *s = site->solution;
    (void)self;
    kiln_control_meet(p->control);
    int status;
    KILN_TRY(kiln_sight_create(&s->sight, p, error));
    KILN_TRY(kiln_radiosity_allgather_limit(s->allgather, s->sight->first, s->sight->units, error));
    KILN_TRY(kiln_sight_want(s->sight, p, s->allgather, false, error));
end:
    return status;
}

static int complete(void *self, const struct kiln_companion_site *site, struct kiln_error *error)
{
    const struct kiln_second_go go = {site->params, site->solution, site->batches, site->taker};
    (void)self;
    return kiln_second_go(&go, error);
}

/* Collective. Sends the radiosity of points to their new owners. */
static int before_move(void *self, const struct kiln_companion_site *site, const uint64_t *bounds,
                       struct kiln_error *error)
{
    const struct kiln_integrate_params *p = site->params;
    const struct kiln_sight *sight = site->solution->sight;
    const uint64_t begin = bounds[p->rank], end = bounds[p->rank + 1];
    uint8_t *wanted = NULL;
    (void)self;
    if (kiln_radiosity_allgather_reach(site->solution->allgather) == NULL)
        return KILN_OK;
    int status;
    KILN_TRY(kiln_agree(p->communicator,
                        kiln_allocate(&wanted, (size_t)sight->units, sizeof *wanted, "the cells of new points", error),
                        error));
    for (uint64_t u = 0; u < sight->units; u++)
        wanted[u] = sight->first[u] < end && sight->first[u + 1] > begin;
    KILN_TRY(kiln_radiosity_allgather_want(site->solution->allgather, wanted, true, error));
end:
    kiln_free(&wanted);
    return status;
}

static int after_move(void *self, const struct kiln_companion_site *site, struct kiln_error *error)
{
    struct kiln_sight *sight = site->solution->sight;
    (void)self;
    const int status = kiln_sight_look(sight, site->params, error);
    return status == KILN_OK ? kiln_sight_want(sight, site->params, site->solution->allgather, true, error) : status;
}

/* ---- what is told of it ---- */

enum { PAIRS, SENT, WHOLE, AGAIN }; /* counts of a rank */

static void count(const struct kiln_solution *s, uint64_t counts[KILN_COMPANION_COUNTS])
{
    counts[PAIRS] = s->sight != NULL ? s->sight->pair_count : 0;
    counts[SENT] = s->sight != NULL ? s->sight->sent : 0;
    counts[WHOLE] = s->report.whole;
    counts[AGAIN] = s->report.computed_again;
}

static void report(const struct kiln_companion_told *told, json_t *json)
{
    const struct kiln_sight *sight = told->solution->sight;
    const uint64_t *counts = told->counts;
    if (sight != NULL)
        (void)json_object_set_new(json, "visible",
                                  json_pack("{s:I, s:I, s:I, s:f, s:I, s:I}", "patches", (json_int_t)sight->units,
                                            "pairs", (json_int_t)counts[PAIRS], "grid_bytes_sent",
                                            (json_int_t)counts[SENT], "grid_seconds", sight->seconds,
                                            "received_between_nodes_of_all", (json_int_t)counts[WHOLE],
                                            "points_computed_again", (json_int_t)counts[AGAIN]));
}

static const char *const no_identity[] = {"exchange-points", NULL};

const struct kiln_companion kiln_companion_reach = {.name = "reach",
                                                    .no_identity = no_identity,
                                                    .wanted = reach_wanted,
                                                    .settle = settle,
                                                    .complete = complete,
                                                    .before_move = before_move,
                                                    .after_move = after_move,
                                                    .count = count,
                                                    .report = {[KILN_REPORT_MPI] = report}};
