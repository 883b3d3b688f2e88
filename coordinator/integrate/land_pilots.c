#include "coordinator/integrate/land_state.h"

#include "coordinator/mpi/agree.h"
#include "worker/base/color.h"
#include "worker/base/memory.h"

enum { PILOTS = 4 }; /* rounds */
/* rays of a point from which factors of techniques are learnt: at least, and a part of those of the step */
enum { PILOT_RAYS = 16, PILOT_PART = 16, PILOT_STREAM = 0x8000, PILOT_TILE_RUNS = 64 };
#define PILOT_ITERATION ((uint64_t)1 << 31)    /* paths of pilots are numbered from this iteration on */
#define EXCHANGE_ITERATION ((uint64_t)1 << 33) /* and those for exchanges */

/* Whether factors are of exchanges between the techniques. */
static bool exchanges(const struct kiln_landing *l) { return l->techniques.mis == KILN_MIS_OPTIMAL; }

/* Paths of a round of pilots; 0: there are none. */
static uint64_t pilot_paths(const struct kiln_landing *l)
{
    const uint64_t paths = l->photons / PILOTS;
    return !kiln_landing_gathers(l) ? 0 : paths > l->aims->count ? paths : l->aims->count;
}

uint64_t kiln_landing_pilot_paths(const struct kiln_landing *l)
{
    return (exchanges(l) ? PILOTS + 1 : PILOTS) * pilot_paths(l);
}

void kiln_landing_use_factors(struct kiln_landing *l)
{
    l->techniques.factors = l->landing_weights.factors = l->factors.of;
    l->techniques.region_of = l->landing_weights.region_of = l->factors.region_of;
}

/* Of a pilot, for the exchanges: of all that will land. */
static void learn_exchange(const struct kiln_landing *l, const struct kiln_landing_record *record, double weight)
{
    const uint32_t own = record->point;
    const double iterations = (double)kiln_landing_iterations(l), less = (double)l->aims->paths / (double)l->photons,
                 area = (double)l->lit[own] * iterations;
    if (!(area > 0.0))
        return;
    const double light = weight * kiln_luminance_of_floats(record->flux) * less / area,
                 more = light * kiln_caustic_exchange_landed(weight);
    float *product = l->moments_of_rays[own].product;
    product[2] += (float)(more * more * iterations / less);
    product[4] += (float)(more * light * iterations / less);
}

/* kiln_take_landings */
static void learn_from_exchanges(void *context, const struct kiln_landing_list *list)
{
    const struct kiln_landing *l = context;
    for (size_t i = 0; i < list->count; i++) {
        const struct kiln_landing_record *record = kiln_landing_of(list, i);
        learn_exchange(l, record, kiln_land_weight(&l->exchange, record));
    }
}

/* kiln_take_landings: of pilots, whose light does not count. */
static void learn_from_landings(void *context, const struct kiln_landing_list *list)
{
    struct kiln_landing *l = context;
    struct kiln_landing_moments moments = {0};
    for (size_t i = 0; i < list->count; i++) {
        const struct kiln_landing_record *record = kiln_landing_of(list, i);
        const double weight = kiln_land_weight(&l->exchange, record);
        kiln_landing_note_moment(l, &moments, record->aim, weight * kiln_luminance_of_floats(record->flux));
    }
    kiln_landing_note_rest(l, &moments);
}

static uint32_t pilot_rays(const struct kiln_step *step)
{
    const uint32_t part = step->samples / PILOT_PART / 4 * 4;
    return part > PILOT_RAYS ? part : PILOT_RAYS;
}

/* Of tile runs, gather rays that bring no light. */
static int gather_pilots(struct kiln_landing *l, uint64_t first, uint64_t count, uint64_t *rays,
                         struct kiln_error *error)
{
    const struct kiln_step *step = &kiln_solution_step(l->solution)->step;
    struct kiln_caustic_techniques techniques = l->techniques;
    techniques.moments = l->moments_of_rays;
    techniques.rays = kiln_landing_own_rays(l);
    const struct kiln_batch batch = {.first = (size_t)first,
                                     .count = (size_t)count,
                                     .stream = step->stream + PILOT_STREAM,
                                     .samples = pilot_rays(step),
                                     .first_sample = step->part * pilot_rays(step)};
    return kiln_landing_run_pass(l, &kiln_pass_weighed, &techniques, &batch, rays, error);
}

/* Collective. `paths` pilots that land, weighed as if they were all that will land: what they exchange with gather rays
 * teaches what is best. */
static int land_pilots(struct kiln_landing *l, uint64_t paths, struct kiln_error *error)
{
    const uint64_t iterations = l->techniques.iterations;
    kiln_landing_aim(l, paths);
    l->techniques.iterations = iterations * (l->photons / paths);
    const int status = kiln_landing_run_paths(l, EXCHANGE_ITERATION + kiln_solution_step(l->solution)->step.part,
                                              PILOTS * paths, learn_from_exchanges, error);
    l->techniques.iterations = iterations;
    l->done = 0;
    kiln_landing_aim(l, l->photons);
    return status;
}

/* Collective. Pilot rays of all points, and where techniques exchange `paths` that land, teach how the techniques
 * count. */
static int learn_factors(struct kiln_landing *l, uint64_t paths, struct kiln_error *error)
{
    const struct kiln_surface *own = &l->solution->own->surface;
    int status =
        kiln_allocate(&l->moments_of_rays, own->count, sizeof *l->moments_of_rays, "the moments of rays", error);
    status = kiln_landing_work_through(l, 0, own->tile_run_count, PILOT_TILE_RUNS, gather_pilots, status, error);
    if (status == KILN_OK)
        kiln_landing_use_factors(l);
    if (status == KILN_OK && exchanges(l))
        status = land_pilots(l, paths, error);
    if (status == KILN_OK)
        status = kiln_land_factors_find(&l->factors, l->params->communicator, l->techniques.mis, l->moments_of_rays,
                                        own, error);
    kiln_free(&l->moments_of_rays);
    return status;
}

int kiln_landing_run_pilots(struct kiln_landing *l, struct kiln_error *error)
{
    const uint64_t paths = pilot_paths(l), part = kiln_solution_step(l->solution)->step.part;
    int status = KILN_OK;
    l->pilots = true;
    kiln_aims_share(l->aims, paths, NULL);
    for (uint64_t i = 0; i < PILOTS && status == KILN_OK; i++) {
        status = kiln_landing_run_paths(l, PILOT_ITERATION + part * PILOTS + i, i * paths, learn_from_landings, error);
        if (status == KILN_OK)
            kiln_landing_correct_aims(l, i + 1 < PILOTS ? paths : l->photons);
        l->done = 0;
    }
    if (status == KILN_OK && kiln_landing_has_factors(l))
        status = learn_factors(l, paths, error);
    l->pilots = false;
    return status;
}
