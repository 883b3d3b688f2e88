/* Runs states whose light a device keeps from bounce to bounce (worker/pass/held.h). This needs a single rank, which
 * has all points, and states that all take the same steps. */
#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/integrate/relight/states_private.h"
#include "worker/backend/extended.h"

enum { SCALE_MOST = 80 }; /* exponents of units, either way */

/* ---- whether ---- */

static bool same_step(const struct kiln_step *a, const struct kiln_step *b)
{
    return a->pass == b->pass && a->stream == b->stream && a->samples == b->samples &&
           a->first_sample == b->first_sample && a->compact == b->compact && a->bounce == b->bounce;
}

/* Whether the device can compute all results of the state. */
static bool is_plain(const struct kiln_state_slot *s)
{
    const struct kiln_rank_data *own = s->solution->own;
    const double scale = kiln_radiosity_allgather_scale(s->solution->allgather);
    return own->error != NULL && own->parts == NULL && own->radiosity == NULL && own->caustic == NULL &&
           abs(ilogb(scale)) <= SCALE_MOST;
}

/* Whether the state can take its next step on a device; *how describes the step. */
static bool may_step(struct kiln_state_slot *s, struct kiln_held_step *how)
{
    const struct kiln_integrator *integrator = s->state.settings->integrator;
    return s->has_next && is_plain(s) && integrator->hold != NULL && integrator->hold(&s->integration, &s->step, how);
}

/* Returns the first of the states that still have steps. */
static struct kiln_state_slot *first_of(const struct kiln_states *st)
{
    struct kiln_state_slot *first = NULL;
    for (size_t i = st->active; i > 0; i--)
        first = st->slots[i - 1].goes_on ? &st->slots[i - 1] : first;
    return first;
}

/* Whether all states with steps can take this step on a device; *how describes it. While some states' direct light is
 * mixed on the device, the others wait before the following step. */
static bool may_hold(const struct kiln_states *st, struct kiln_held_step *how)
{
    const struct kiln_surface *surface = st->params->surface;
    const struct kiln_state_slot *first = first_of(st);
    bool may = st->may_hold && first != NULL && st->active <= KILN_ROW_LIGHTS &&
               kiln_backend_holds(st->params->backend) && surface->count == surface->point_count;
    const bool mixes = may && kiln_state_mixes(first);
    for (size_t i = 0; i < st->active && may; i++) {
        struct kiln_state_slot *s = &st->slots[i];
        struct kiln_held_step waits;
        may = s->goes_on ? same_step(&s->step, &first->step) && may_step(s, how)
                         : mixes && !kiln_state_mixes(s) && may_step(s, &waits);
    }
    return may;
}

/* ---- beginning ---- */

/* Copies the host's data of the states to the device, which mixes the light it may. */
static int bring(struct kiln_states *st, struct kiln_error *error)
{
    struct kiln_held_light lights[KILN_STATES_MOST];
    const struct kiln_state_slot *first = first_of(st);
    const struct kiln_step *direct = st->how.direct ? &first->step : &kiln_solution_step(first->solution)->step;
    const struct kiln_held begin = {.lights = lights,
                                    .count = (uint32_t)st->active,
                                    .compact = direct->compact,
                                    .stream = direct->stream,
                                    .seed = (uint32_t)first->state.settings->seed};
    for (size_t i = 0; i < st->active; i++) {
        const struct kiln_state_slot *s = &st->slots[i];
        const struct kiln_rank_data *own = s->solution->own;
        lights[i] = (struct kiln_held_light){.next = own->next,
                                             .sum = own->sum,
                                             .albedo = own->surface.albedo,
                                             .error = own->error,
                                             .mixed = st->how.direct && s->goes_on,
                                             .samples = s->step.samples,
                                             .parts = s->state.direct.parts,
                                             .part_count = s->state.direct.part_count,
                                             .scale = kiln_radiosity_allgather_scale(s->solution->allgather),
                                             .unit = s->ledger.unit,
                                             .unit_squared = s->ledger.unit_squared};
    }
    return kiln_backend_hold(st->params->backend, &begin, &st->holds, st->powers[0], error);
}

static int begin_steps(struct kiln_states *st, struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t i = 0; i < st->active && status == KILN_OK; i++) {
        struct kiln_state_slot *s = &st->slots[i];
        struct kiln_step_reports *steps = &s->solution->report.steps;
        if (!s->goes_on)
            continue;
        s->mixed = s->mixed || st->how.direct;
        status = kiln_step_reports_reserve(steps, steps->count + 1, error);
        if (status != KILN_OK)
            break;
        steps->of[steps->count++] = (struct kiln_step_report){.step = s->step};
        kiln_ledger_begin_step(&s->ledger);
    }
    return status;
}

int kiln_states_hold(struct kiln_states *st, bool *held, struct kiln_error *error)
{
    int status = KILN_OK;
    *held = may_hold(st, &st->how);
    if (*held && !st->holds)
        status = bring(st, error);
    if (!st->holds || status != KILN_OK) {
        *held = false;
        return status == KILN_NO_DEVICE ? KILN_OK : status;
    }
    assert(*held);
    return begin_steps(st, error);
}

/* ---- a step ---- */

static __int128 power_of(const struct kiln_held_power *power)
{
    return ((__int128)power->high * ((int64_t)1 << 40)) + power->low;
}

/* Adds the device's powers to the ledger, whose sums have the same order. */
static void take_powers(struct kiln_state_slot *s, const struct kiln_held_power powers[KILN_HELD_POWERS])
{
    _Static_assert(KILN_SUM_INCIDENT == 0 && KILN_SUM_REFLECTED == 3 && KILN_SUM_SENT == 6 && KILN_SUM_ESCAPED == 9 &&
                       KILN_SUM_BLOCKED == 12 && KILN_HELD_POWERS == 16,
                   "worker/pass/held.h");
    for (int k = 0; k < KILN_HELD_POWERS - 1; k++)
        s->ledger.sums[k].value = power_of(&powers[k]);
    s->ledger.variance.value = power_of(&powers[KILN_HELD_POWERS - 1]);
}

/* Copies the light of all states back to the host. */
static int fetch(struct kiln_states *st, struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t i = 0; i < st->active && status == KILN_OK; i++) {
        struct kiln_state_slot *s = &st->slots[i];
        const struct kiln_rank_data *own = s->solution->own;
        const struct kiln_held_fetch to = {.sum = own->sum,
                                           .error = own->error,
                                           .error_indirect = own->error_indirect,
                                           .direct = s->mixed ? own->direct : NULL,
                                           .error_direct = s->mixed ? own->error_direct : NULL};
        /* fields that are overwritten, and those that no gather reads any more */
        const void *const written[] = {
            own->next,  own->sum,          own->direct,
            own->error, own->error_direct, own->error_direct != NULL ? own->error_indirect : NULL,
            NULL};
        kiln_state_clear_fields(s, written);
        status = kiln_backend_hold_fetch(st->params->backend, (uint32_t)i, &to, error);
    }
    return status;
}

/* The gather of all states. */
static int gather(struct kiln_states *st, struct kiln_error *error)
{
    const struct kiln_state_slot *first = &st->slots[0];
    const struct kiln_resident_rows *memory;
    const struct kiln_batch batch = {.count = first->solution->own->surface.tile_run_count,
                                     .stream = first->step.stream,
                                     .samples = first->step.samples,
                                     .first_sample = first->step.first_sample};
    memset(st->wanted, 1, batch.count);
    const int status = kiln_resident_step(st->resident, first->solution, &first->step, st->wanted, &memory, error);
    return status == KILN_OK
               ? kiln_backend_hold_step(st->params->backend, kiln_resident_for_backend(st->resident, memory), &batch,
                                        &st->how, st->powers[0], error)
               : status;
}

int kiln_states_run_held(struct kiln_states *st, struct kiln_error *error)
{
    int status;
    KILN_TRY(st->how.direct ? KILN_OK : gather(st, error)); /* direct light came with the copied data */
    for (size_t i = 0; i < st->active; i++)
        if (st->slots[i].goes_on)
            take_powers(&st->slots[i], st->powers[i]);
    if (st->how.final)
        KILN_TRY(fetch(st, error));
    if (st->how.final)
        st->holds = false;
end:
    return status;
}
