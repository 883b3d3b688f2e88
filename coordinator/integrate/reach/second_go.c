#include "coordinator/integrate/reach/second_go.h"

#include <string.h>

#include "coordinator/run/control.h"
#include "coordinator/mpi/agree.h"
#include "worker/base/arena.h"
#include "worker/base/memory.h"
#include "worker/scene/radiosity.h"

enum { ATTEMPTS = 4 }; /* then everything is asked for */

/* ---- running tile runs again ---- */

/* Held tile runs: those of this rank that lacked radiosity, and the range that they lie in. */
struct retried {
    const struct kiln_second_go *go;
    size_t first, end; /* tile runs */
    size_t count;
    uint64_t points;
    uint32_t *samples; /* per tile run of the range: samples; 0: not held */
    uint64_t *place;   /* number of a held tile run's first point among the held points */
};

static void held_release(struct retried *h)
{
    kiln_free(&h->samples);
    kiln_free(&h->place);
}

static void find_range(struct retried *h)
{
    const struct kiln_rank_data *own = h->go->solution->own;
    h->first = h->end = h->count = 0;
    h->points = 0;
    for (size_t f = 0; f < own->surface.tile_run_count; f++) {
        if (own->lacking[f] == 0)
            continue;
        h->first = h->count == 0 ? f : h->first;
        h->end = f + 1;
        h->points += own->surface.tile_runs[f].count;
        h->count++;
    }
}

static int find_held(struct retried *h, struct kiln_error *error)
{
    const struct kiln_rank_data *own = h->go->solution->own;
    const struct kiln_field_set *fields = h->go->params->fields;
    const struct kiln_step *step = &kiln_solution_step(h->go->solution)->step;
    const uint32_t *each = step->samples_field == NULL
                               ? NULL
                               : kiln_rank_field(own, fields, kiln_field_set_find(fields, step->samples_field));
    uint64_t points = 0;
    find_range(h);
    int status;
    KILN_TRY(kiln_allocate(&h->samples, h->end - h->first, sizeof *h->samples, "tile runs to compute again", error));
    KILN_TRY(kiln_allocate(&h->place, h->end - h->first, sizeof *h->place, "tile runs to compute again", error));
    for (size_t f = h->first; f < h->end; f++) {
        if (own->lacking[f] == 0)
            continue;
        h->samples[f - h->first] = each != NULL ? each[f] : step->samples;
        h->place[f - h->first] = points;
        points += own->surface.tile_runs[f].count;
    }
end:
    return status;
}

static int run_held(const struct retried *h, kiln_take_results take, void *context, bool may_lack,
                    struct kiln_error *error)
{
    const struct kiln_second_go *go = h->go;
    const struct kiln_step *step = &kiln_solution_step(go->solution)->step;
    if (h->count == 0)
        return KILN_OK;
    struct kiln_batch batch = {.first = h->first,
                               .count = h->end - h->first,
                               .stream = step->stream,
                               .samples = step->samples,
                               .first_sample = step->first_sample,
                               .samples_each = h->samples,
                               .may_lack = may_lack,
                               .take = take,
                               .context = context};
    int status;
    KILN_TRY(kiln_batches_choose(go->batches, go->solution->own, &batch, error));
    uint64_t rays = 0; /* the step's rays are counted */
    KILN_TRY(kiln_backend_set_radiosity(go->params->backend, go->solution->radiosity, error));
    KILN_TRY(kiln_backend_run(go->params->backend, step->pass, step->parameters, &batch, &rays, error));
end:
    return status;
}

/* ---- what they have met ---- */

/* Search for the absent units that the held points' rays have met. Units are found digit by digit, in base 3. */
struct search {
    struct retried *retried;
    uint64_t count;  /* absent units */
    uint64_t *units; /* their numbers, ascending */
    uint64_t *rank;  /* per absent unit: its index in `units` */
    uint32_t levels;
    uint64_t stride; /* 3 ^ levels after the present one */
    uint8_t *met;    /* per level and held point: digits that were met, as bits of channels */
    uint32_t level;
    struct kiln_arena arena;
};

static uint64_t digit_of(const struct search *s, uint64_t unit) { return s->rank[unit] / s->stride % 3; }

/* Marks a unit with its digit, for kiln_radiosity_allgather_mark. */
static uint64_t mark_digit(const void *context, uint64_t unit)
{
    return kiln_radiosity_absent(1u << digit_of(context, unit));
}

/* kiln_take_results */
static int take_digits(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    (void)error;
    const struct search *s = context;
    const struct kiln_second_go *go = s->retried->go;
    const struct kiln_pass *pass = kiln_solution_step(go->solution)->step.pass;
    const struct kiln_tile_run *runs = go->solution->own->surface.tile_runs;
    const char *result = results;
    for (size_t f = first; f < first + count; f++) {
        uint8_t *met = s->met + s->level * s->retried->points + s->retried->place[f - s->retried->first];
        for (uint32_t i = 0; i < runs[f].count; i++, result += pass->result_bytes)
            met[i] = (uint8_t)pass->lacks(result);
    }
    return KILN_OK;
}

static int list_absent(struct search *s, const uint8_t *reach, uint64_t units, struct kiln_error *error)
{
    int status = kiln_arena_allocate(&s->arena, &s->units, (size_t)units, sizeof *s->units,
                                     "the units that a node lacks", error);
    if (status == KILN_OK)
        status = kiln_arena_allocate(&s->arena, &s->rank, (size_t)units, sizeof *s->rank, "the units that a node lacks",
                                     error);
    for (uint64_t u = 0; u < units; u++) { /* all units of the node are counted, whatever memory this rank has */
        if (reach[u] != 0)
            continue;
        if (status == KILN_OK) {
            s->units[s->count] = u;
            s->rank[u] = s->count;
        }
        s->count++;
    }
    for (uint64_t most = 1; most < s->count; most *= 3)
        s->levels++;
    if (status == KILN_OK)
        status = kiln_arena_allocate(&s->arena, &s->met, (size_t)(s->levels * s->retried->points), sizeof *s->met,
                                     "what points have met", error);
    return status;
}

static void search_release(struct search *s) { kiln_arena_release(&s->arena); }

/* Requests the units whose digits from `level` on are all among those that point i has met; `begin`: number given by
 * the digits before. */
static void ask(const struct search *s, uint64_t i, uint32_t level, uint64_t begin, uint64_t stride, uint8_t *wanted)
{
    if (level == s->levels) {
        wanted[s->units[begin]] = 1;
        return;
    }
    for (uint64_t digit = 0; digit < 3; digit++)
        if (((uint32_t)s->met[level * s->retried->points + i] >> digit & 1u) != 0 && begin + digit * stride < s->count)
            ask(s, i, level + 1, begin + digit * stride, stride / 3, wanted);
}

/* Collective on the node. Requests the units that the held tile runs have met. */
static int find_met(struct retried *h, uint64_t units, uint8_t *wanted, struct kiln_error *error)
{
    struct kiln_radiosity_allgather *allgather = h->go->solution->allgather;
    struct search s = {.retried = h};
    uint64_t first = 1;
    int status = list_absent(&s, kiln_radiosity_allgather_reach(allgather), units, error);
    /* all of the node's ranks or none: of ranks that cannot mark, points are not found */
    status = kiln_agree(kiln_node_communicator(h->go->params->node), status, error);
    for (uint32_t level = 1; level < s.levels; level++)
        first *= 3;
    s.stride = first;
    for (s.level = 0; s.level < s.levels; s.level++, s.stride /= 3) {
        if (status != KILN_OK)
            break;
        kiln_radiosity_allgather_mark(allgather, mark_digit, &s);
        status =
            kiln_agree(kiln_node_communicator(h->go->params->node), run_held(h, take_digits, &s, true, error), error);
    }
    kiln_radiosity_allgather_mark_absent(allgather);
    for (uint64_t i = 0; status == KILN_OK && i < h->points && s.count > 0; i++)
        ask(&s, i, 0, 0, first, wanted);
    search_release(&s);
    return status;
}

/* Collective. */
static int receive(struct retried *h, bool everything, struct kiln_error *error)
{
    const struct kiln_integrate_params *p = h->go->params;
    const struct kiln_solution *solution = h->go->solution;
    const uint64_t units = solution->sight->units;
    uint8_t *wanted = NULL;
    uint64_t any = h->count;
    int status = kiln_agree(p->communicator,
                            kiln_allocate(&wanted, (size_t)units, sizeof *wanted, "what a node lacks", error), error);
    if (status != KILN_OK)
        return status;
    (void)MPI_Allreduce(MPI_IN_PLACE, &any, 1, MPI_UINT64_T, MPI_SUM, kiln_node_communicator(p->node));
    if (any > 0 && everything)
        memset(wanted, 1, (size_t)units);
    else if (any > 0)
        status = find_met(h, units, wanted, error);
    status = kiln_agree(p->communicator, status, error);
    if (status == KILN_OK)
        status = kiln_radiosity_allgather_want(solution->allgather, wanted, true, error);
    kiln_free(&wanted);
    return status;
}

/* ---- the second go ---- */

/* kiln_take_results; the context is a kiln_second_go. */
static int take_again(void *context, size_t first, size_t count, const void *results, struct kiln_error *error)
{
    const struct kiln_second_go *go = context;
    const struct kiln_rank_data *own = go->solution->own;
    memset(own->lacking + first, 0, count * sizeof *own->lacking);
    return kiln_taker_take(go->taker, own, first, count, NULL, results, error);
}

static bool has_all(const struct kiln_second_go *go)
{
    const uint8_t *reach = kiln_radiosity_allgather_reach(go->solution->allgather);
    return reach == NULL || memchr(reach, 0, (size_t)go->solution->sight->units) == NULL;
}

/* Collective. Receives the radiosity that the held tile runs need, and computes them. Those that lack some again stay
 * held. */
static int attempt(struct retried *h, bool everything, struct kiln_error *error)
{
    const struct kiln_second_go *go = h->go;
    int status = kiln_agree(go->params->communicator, find_held(h, error), error);
    if (status == KILN_OK)
        status = receive(h, everything, error);
    if (status != KILN_OK)
        return status;
    go->taker->may_lack = !has_all(go);
    go->solution->report.computed_again += h->points;
    struct kiln_second_go context = *go;
    return kiln_agree(go->params->communicator, run_held(h, take_again, &context, go->taker->may_lack, error), error);
}

static uint64_t held_of_all(const struct kiln_second_go *go)
{
    struct retried h = {.go = go};
    find_range(&h);
    uint64_t count = h.count;
    (void)MPI_Allreduce(MPI_IN_PLACE, &count, 1, MPI_UINT64_T, MPI_SUM, go->params->communicator);
    return count;
}

int kiln_second_go(const struct kiln_second_go *go, struct kiln_error *error)
{
    const struct kiln_integrate_params *p = go->params;
    struct kiln_step_report *report = kiln_solution_step(go->solution);
    const double start = MPI_Wtime();
    int status = KILN_OK;
    if (!report->step.pass->reads_radiosity || go->solution->own->lacking == NULL)
        return KILN_OK;
    for (uint32_t i = 0; status == KILN_OK && held_of_all(go) > 0; i++) {
        struct retried h = {.go = go};
        /* it may take as long as the step */
        kiln_control_blocking(p->control, "radiosity of what was not seen before", 60.0 + 100.0 * report->seconds);
        status = attempt(&h, i + 1 >= ATTEMPTS, error);
        kiln_control_blocking(p->control, NULL, 0.0);
        held_release(&h);
    }
    report->seconds += MPI_Wtime() - start;
    return status;
}
