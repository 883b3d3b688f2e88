#include "coordinator/integrate/land/land_state.h"

#include <string.h>

#include "coordinator/run/control.h"
#include "coordinator/mpi/agree.h"
#include "worker/backend/extended.h"
#include "worker/backend/mirror_images.h"
#include "worker/base/arena.h"
#include "worker/base/memory.h"
#include "worker/light/emission.h"
#include "worker/pass/land.h"
#include "worker/pass/weighed.h"

#define BEAM_TEXELS 4.0 /* least area of a beam for mirror images (mirror_images.h), in mean texel areas */

static int make_room(struct kiln_landing *l, struct kiln_error *error)
{
    const size_t aims = l->aims->count;
    const char *what = "the moments of light paths";
    int status;
    KILN_TRY(kiln_arena_allocate(&l->arena, &l->moments, aims, sizeof *l->moments, what, error));
    KILN_TRY(kiln_arena_allocate(&l->arena, &l->moments_before, aims, sizeof *l->moments_before, what, error));
    KILN_TRY(kiln_arena_allocate(&l->arena, &l->learnt, aims, sizeof *l->learnt, what, error));
    KILN_TRY(kiln_arena_allocate(&l->arena, &l->paths, aims, sizeof *l->paths, what, error));
    KILN_TRY(kiln_arena_allocate(&l->arena, &l->weights, aims, sizeof *l->weights, what, error));
    KILN_TRY(kiln_arena_allocate(&l->arena, &l->landed, l->params->threads, sizeof *l->landed, what, error));
    KILN_TRY(kiln_arena_allocate(&l->arena, &l->results, KILN_LANDING_GIVEN_TILE_RUNS * KILN_TILE_TEXELS,
                                 sizeof *l->results, "the answers of tile runs", error));
end:
    return status;
}

/* Least area of a spot's beam, m2: smaller ones are missed by most samples of a texel. The same on all ranks. */
static double narrow_beam(const struct kiln_integrate_params *p)
{
    return p->surface->point_count > 0 ? BEAM_TEXELS * p->area / (double)p->surface->point_count : 0.0;
}

/* Announces the coming passes to the backend, if any lamp is to be traced from. */
static void expect(const struct kiln_landing *l)
{
    const struct kiln_land_parameters parameters = {.aims = l->aims,
                                                    .techniques = kiln_landing_shares(l) ? &l->techniques : NULL};
    struct kiln_backend *backend = l->params->backend;
    if (l->aims->count == 0)
        return;
    kiln_backend_expect(backend, &kiln_pass_land, &parameters);
    if (kiln_landing_gathers(l))
        kiln_backend_expect(backend, &kiln_pass_weighed, &l->techniques);
}

int kiln_landing_create(struct kiln_landing **landing, const struct kiln_integrate_params *params,
                        struct kiln_solution *solution, const struct kiln_saved *saved, struct kiln_error *error)
{
    struct kiln_landing *l = NULL;
    int status = kiln_allocate(&l, 1, sizeof *l, "the landings of light", error);
    *landing = l;
    if (status != KILN_OK)
        return status;
    *l = (struct kiln_landing){.params = params, .solution = solution, .saved = saved};
    status = kiln_aims_create(&l->aims, params->backend->params.lights, kiln_landing_aims(params->settings), error);
    const uint64_t photons = status == KILN_OK ? kiln_landing_photons(params->settings, l->aims->count) : 0;
    l->photons = photons;
    KILN_TRY(status);
    solution->report.landing = (struct kiln_landing_report){
        .photons = photons, .iterations = params->settings->iterations, .aims = l->aims->count};
    if (photons < l->aims->count)
        KILN_TRY(
            kiln_fail(error, KILN_USAGE,
                      "--photons %llu is less than the %zu pairs of a lamp and an object with gloss, each of which "
                      "needs a path: give --photons %zu or more",
                      (unsigned long long)photons, l->aims->count, l->aims->count));
    KILN_TRY(make_room(l, error));
    if (params->settings->caustics == KILN_CAUSTICS_VCM)
        KILN_TRY(kiln_emission_create(&l->emission, params->backend->params.lights, error));
    if (kiln_landing_shares(l))
        KILN_TRY(kiln_mirror_images_create(&l->images, params->backend->params.lights, narrow_beam(params), error));
end:
    l->techniques = (struct kiln_caustic_techniques){
        .aims = l->aims, .emission = l->emission, .images = l->images, .mis = params->settings->mis};
    if (status == KILN_OK)
        expect(l);
    else
        kiln_landing_destroy(landing);
    return status;
}

void kiln_landing_end(struct kiln_landing *l)
{
    kiln_backend_destroy(&l->own);
    kiln_land_exchange_release(&l->exchange);
    if (l->merge != NULL)
        kiln_merge_rest(l->merge);
    l->merging = false;
    kiln_free(&l->sums);
    kiln_free(&l->merged);
    kiln_free(&l->gathered);
    for (int half = 0; half < 2; half++)
        kiln_free(&l->tried[half]);
    if (l->params->settings->parts <= 1 || kiln_land_trial_leaves_out(l))
        kiln_landing_points_moved(l);
}

void kiln_landing_points_moved(struct kiln_landing *l)
{
    kiln_merge_destroy(&l->merge);
    l->merging = false;
    kiln_free(&l->lit);
    kiln_free(&l->places);
}

void kiln_landing_destroy(struct kiln_landing **landing)
{
    struct kiln_landing *l = *landing;
    if (l == NULL)
        return;
    kiln_landing_end(l);
    kiln_landing_points_moved(l);
    kiln_aims_destroy(&l->aims);
    kiln_emission_destroy(&l->emission);
    kiln_mirror_images_destroy(&l->images);
    kiln_arena_release(&l->arena);
    kiln_free(landing);
}

static void find_lit(const struct kiln_landing *l)
{
    const struct kiln_surface *s = &l->solution->own->surface;
#pragma omp parallel for schedule(dynamic, 16) num_threads((int)l->params->threads)
    for (size_t f = 0; f < s->tile_run_count; f++) {
        struct kiln_point_cursor at = kiln_point_first(s, f);
        for (uint32_t k = 0; k < s->tile_runs[f].count; k++, kiln_point_next(s, &at))
            if (kiln_point_valid(s, at.point) && !kiln_landing_is_receiver(l, f))
                l->lit[at.point.at] = (float)kiln_lit_area(s, at.point, kiln_landing_presence(l, s, &at));
    }
}

/* Paths of a batch, at most. */
static uint64_t most_of_batch(const struct kiln_landing *l)
{
    const uint64_t pilots = kiln_landing_pilot_paths(l), most = l->photons > pilots ? l->photons : pilots;
    return most < KILN_LAND_BATCH ? most : KILN_LAND_BATCH;
}

/* Collective. */
static int begin_step(struct kiln_landing *l, struct kiln_error *error)
{
    const struct kiln_surface *own = &l->solution->own->surface;
    int status = kiln_allocate(&l->sums, own->count, sizeof *l->sums, "the light that lands on points", error);
    const bool finds = l->lit == NULL && (kiln_landing_merges(l) || kiln_landing_shares(l));
    if (status == KILN_OK && finds)
        status = kiln_allocate(&l->lit, own->count, sizeof *l->lit, "the areas of points", error);
    if (status == KILN_OK && (kiln_landing_merges(l) || kiln_landing_spreads(l->params->settings)))
        status = kiln_allocate(&l->merged, own->count, sizeof *l->merged, "the light that is merged", error);
    if (status == KILN_OK && kiln_landing_spreads(l->params->settings))
        status = kiln_allocate(&l->gathered, own->count, sizeof *l->gathered, "the light that rays find", error);
    status = kiln_agree(l->params->communicator, status, error);
    if (status == KILN_OK && finds)
        find_lit(l);
    if (status == KILN_OK)
        status = kiln_land_exchange_create(&l->exchange, l->params->communicator, l->params->node, own->first.at,
                                           own->count, most_of_batch(l), l->params->settings->exchange_limit, error);
    l->landing_weights = (struct kiln_landing_weights){
        .mis = l->techniques.mis, .rays = (double)kiln_landing_own_rays(l), .area = l->lit};
    l->solution->report.landing.rays = kiln_landing_gathers(l) ? kiln_landing_own_rays(l) : 0;
    l->exchange.weights = kiln_landing_shares(l) ? &l->landing_weights : NULL;
    l->exchange.threads = l->params->threads;
    l->techniques.iterations = kiln_landing_iterations(l);
    return status;
}

/* Implements kiln_take_landings: adds the light of the landings. */
static void add_landings(void *context, const struct kiln_landing_list *list)
{
    const struct kiln_landing *l = context;
    for (size_t i = 0; i < list->count; i++) {
        const struct kiln_landing_record *record = kiln_landing_of(list, i);
        kiln_landing_fetch_sum(list, i, l->sums);
        kiln_land_add(record, kiln_land_weight(&l->exchange, record), &l->sums[record->point]);
    }
}

/* Collective. Runs all remaining iterations. */
static int run_iterations(struct kiln_landing *l, struct kiln_error *error)
{
    const uint64_t iterations = kiln_landing_iterations(l),
                   number = kiln_solution_step(l->solution)->step.first_iteration;
    int status = KILN_OK;
    while (l->iteration < iterations && status == KILN_OK) {
        status = kiln_landing_run_paths(l, number + l->iteration,
                                        kiln_landing_pilot_paths(l) + l->iteration * l->photons, add_landings, error);
        if (status == KILN_OK && kiln_landing_merges(l) &&
            (kiln_merge_radius_ends(l->iteration) || l->iteration + 1 == iterations))
            status = kiln_landing_merge(l, error);
        if (status == KILN_OK && l->iteration + 1 < iterations && !kiln_landing_shares(l))
            kiln_landing_correct_aims(l, l->photons);
        l->iteration++;
        l->done = 0;
    }
    return status == KILN_OK && kiln_landing_spreads(l->params->settings) ? kiln_landing_spread(l, error) : status;
}

int kiln_landing_run(struct kiln_landing *l, struct kiln_error *error)
{
    const uint64_t iterations = kiln_landing_iterations(l), pilots = kiln_landing_pilot_paths(l);
    kiln_landing_forget(l);
    kiln_landing_end(l);
    l->solution->report.landing.rays = 0;
    if (kiln_land_trial_leaves_out(l))
        return KILN_OK;
    int status = begin_step(l, error);
    if (status == KILN_OK)
        status = kiln_landing_restore(l, error);
    kiln_progress_phase(l->params->progress, "light paths", pilots + iterations * l->photons);
    kiln_progress_advance(l->params->progress, l->restored ? pilots + l->iteration * l->photons + l->done : 0);
    kiln_control_begin(l->params->control, "light paths");
    if (status == KILN_OK && pilots > 0 && !l->restored && !kiln_land_trial_leaves_out(l))
        status = kiln_landing_run_pilots(l, error);
    if (kiln_land_trial_leaves_out(l))
        l->solution->report.landing.rays = 0;
    return status == KILN_OK && l->aims->count > 0 && !kiln_land_trial_leaves_out(l) ? run_iterations(l, error)
                                                                                     : status;
}
