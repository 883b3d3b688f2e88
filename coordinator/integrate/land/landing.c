#include <assert.h>

#include "coordinator/integrate/companion.h"
#include "coordinator/integrate/land/land.h"
#include "coordinator/integrate/land/land_plan.h"
#include "coordinator/integrate/land/land_report.h"

static_assert((int)KILN_LANDING_ARRAYS <= (int)KILN_COMPANION_ARRAYS, "a checkpoint has room for landings");

static bool landing_wanted(const struct kiln_integrate_params *params)
{
    return params->settings->caustics >= KILN_CAUSTICS_LAND;
}

static int create(void **self, const struct kiln_companion_site *site, struct kiln_error *error)
{
    struct kiln_landing *l = NULL;
    const int status = kiln_landing_create(&l, site->params, site->solution, site->saved, error);
    *self = l;
    return status;
}

static void destroy(void **self)
{
    struct kiln_landing *l = *self;
    kiln_landing_destroy(&l);
    *self = NULL;
}

static int before_step(void *self, const struct kiln_companion_site *site, struct kiln_error *error)
{
    (void)site;
    return kiln_landing_run(self, error);
}

static int complete(void *self, const struct kiln_companion_site *site, struct kiln_error *error)
{
    (void)site;
    (void)error;
    kiln_landing_end(self);
    return KILN_OK;
}

static int after_move(void *self, const struct kiln_companion_site *site, struct kiln_error *error)
{
    (void)site;
    (void)error;
    kiln_landing_points_moved(self);
    return KILN_OK;
}

static int answer(void *self, const struct kiln_batch *batch, struct kiln_error *error)
{
    return kiln_landing_give(self, batch, error);
}

static size_t blocks(void *self, struct kiln_array_range *of) { return kiln_landing_arrays(self, of); }

static uint64_t saved_bytes(const struct kiln_integrate_settings *settings)
{
    return kiln_landing_saved_bytes(settings->caustics);
}

/* A first round may have left all paths out. */
static void close_energy(const struct kiln_companion_site *site, struct kiln_energy_closing *closing)
{
    if (kiln_caustics_found(&site->solution->report.steps).left_out)
        closing->caustics = KILN_CAUSTICS_NONE;
}

/* Caustics that were asked for by name always come. */
static void identify(const struct kiln_job *job, json_t *fields)
{
    if (job->light.caustics_tried)
        (void)json_object_set_new(fields, "caustics tried", json_string("yes"));
}

static const char *const identity[] = {"mis", "photons", "iterations", "merge-radius", "radius-alpha", NULL};

const struct kiln_companion kiln_companion_landing = {
    .name = "landing",
    .by_step = true,
    .identity = identity,
    .identity_after = "caustics",
    .wanted = landing_wanted,
    .create = create,
    .destroy = destroy,
    .before_step = before_step,
    .complete = complete,
    .answer = answer,
    .after_move = after_move,
    .blocks = blocks,
    .saved_bytes = saved_bytes,
    .close = close_energy,
    .identify = identify,
    .report = {[KILN_REPORT_MATERIALS] = kiln_landing_report_materials, [KILN_REPORT_STEP] = kiln_landing_report_step},
    .measure = kiln_landing_measure,
    .demand = kiln_landing_demand};
