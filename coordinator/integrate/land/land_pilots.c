#include "coordinator/integrate/land/land_state.h"

#include "coordinator/mpi/agree.h"
#include "worker/base/color.h"

enum { PILOTS = 4 };                        /* rounds */
#define PILOT_ITERATION ((uint64_t)1 << 31) /* paths of pilots are numbered from this iteration on */

/* Returns the number of paths in a round of pilots; 0: no pilots. */
static uint64_t pilot_paths(const struct kiln_landing *l)
{
    const uint64_t paths = l->photons / PILOTS;
    return !kiln_landing_gathers(l) ? 0 : paths > l->aims->count ? paths : l->aims->count;
}

uint64_t kiln_landing_pilot_paths(const struct kiln_landing *l) { return PILOTS * pilot_paths(l); }

/* Implements kiln_take_landings for pilots, whose light is not added to the result. */
static void learn_from_landings(void *context, const struct kiln_landing_list *list)
{
    struct kiln_landing *l = context;
    struct kiln_landing_moments moments = {0};
    kiln_land_trial_add(l, list, l->half);
    for (size_t i = 0; i < list->count; i++) {
        const struct kiln_landing_record *record = kiln_landing_of(list, i);
        const double weight = kiln_land_weight(&l->exchange, record);
        kiln_landing_note_moment(l, &moments, record->aim, weight * kiln_luminance_of_floats(record->flux));
    }
    kiln_landing_note_rest(l, &moments);
}

int kiln_landing_run_pilots(struct kiln_landing *l, struct kiln_error *error)
{
    const uint64_t paths = pilot_paths(l), part = kiln_solution_step(l->solution)->step.part;
    int status = KILN_OK;
    l->pilots = true;
    kiln_aims_share(l->aims, paths, NULL);
    status = kiln_agree(l->params->communicator, kiln_land_trial_begin(l, error), error);
    for (uint64_t i = 0; i < PILOTS && status == KILN_OK; i++) {
        l->half = (int)(i % 2);
        status = kiln_landing_run_paths(l, PILOT_ITERATION + part * PILOTS + i, i * paths, learn_from_landings, error);
        if (status == KILN_OK)
            kiln_landing_correct_aims(l, i + 1 < PILOTS ? paths : l->photons);
        l->done = 0;
    }
    if (status == KILN_OK)
        status = kiln_land_trial_end(l, PILOTS / 2, error);
    l->pilots = false;
    return status;
}
