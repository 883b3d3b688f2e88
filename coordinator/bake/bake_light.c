#include "coordinator/bake/bake_private.h"
#include "coordinator/bake/settings/light_settings.h"
#include "coordinator/bake/light/reference_radius.h"
#include "coordinator/bake/prepare/stages.h"
#include "coordinator/integrate/companion.h"
#include "coordinator/integrate/patches/emission.h"
#include "coordinator/integrate/relight/groups.h"
#include "coordinator/mpi/agree.h"

static bool has_step(const struct kiln_step_reports *steps, uint32_t role)
{
    size_t i = 0;
    while (i < steps->count && steps->of[i].step.role != role)
        i++;
    return i < steps->count;
}

/* Adds the seconds that each companion took beside a step to the companion's phase. `step` NULL: adds the phases
 * themselves, with 0 s. */
static void add_companion_phases(struct kiln_bake *b, const struct kiln_step_report *step)
{
    for (size_t i = 0; kiln_companions[i] != NULL; i++)
        if (kiln_companions[i]->phase != NULL && kiln_companions[i]->wanted(&b->light_params))
            kiln_phase_add(&b->phases, kiln_companions[i]->phase,
                           step != NULL ? kiln_companions[i]->beside(step) : 0.0);
}

/* Adds the times of the steps to the phases of their roles. */
static void add_light_phases(struct kiln_bake *b)
{
    const struct kiln_integrate_report *report = &b->solution->report;
    const struct kiln_roles *roles = &report->roles;
    for (uint32_t r = 0; r < roles->count; r++)
        if (!roles->of[r]->optional || has_step(&report->steps, r))
            kiln_phase_add(&b->phases, roles->of[r]->phase, 0.0);
    add_companion_phases(b, NULL);
    kiln_phase_add(&b->phases, "exchange", 0.0);
    kiln_phase_add(&b->phases, "waiting", report->waiting_seconds);
    for (size_t i = 0; i < report->steps.count; i++) {
        const struct kiln_step_report *step = &report->steps.of[i];
        kiln_phase_add(&b->phases, roles->of[step->step.role]->phase, step->seconds);
        kiln_phase_add(&b->phases, "exchange", step->exchange_seconds);
        add_companion_phases(b, step);
    }
}

/* Collective. Finds the points that the views of --only-visible-from need. */
static int find_visible(struct kiln_bake *b, struct kiln_error *error)
{
    if (b->job->light.only_visible_from == NULL)
        return KILN_OK;
    kiln_phase(&b->phases, "views");
    kiln_progress_phase(b->progress, "views", 0);
    const int status = kiln_visible_from_find(&b->visible, b->prepared, b->job->light.only_visible_from, error);
    return kiln_bake_end_phase(b, status, error);
}

/* Collective. The parameters of paths from surface points, with the radius of merging where --merge-radius leaves it to
 * kiln. */
static int settle_paths(struct kiln_bake *b, struct kiln_error *error)
{
    const struct kiln_surface *surface = b->prepared->surface;
    double texel = 0.0;
    int status = KILN_OK;
    b->paths = b->job->light.paths;
    if (b->light_settings.reference == NULL)
        return KILN_OK;
    if (b->paths.method == KILN_REFERENCE_VCM && b->paths.radius == 0.0) {
        status = kiln_median_texel(surface, b->communicator, &texel, error);
        b->paths.radius = kiln_reference_radius(texel, surface->point_count);
    }
    b->light_settings.reference = &b->paths;
    return status;
}

/* Starts threads that pack columns of kiln.h5 while light is computed: `start` of b->beside (struct kiln_beside). */
static void pack_ahead(void *context, const struct kiln_rank_data *own)
{
    struct kiln_bake *b = context;
    const struct kiln_bake_result result = {.scene = b->prepared->scene,
                                            .geometry = b->prepared->geometry,
                                            .surface = b->prepared->surface,
                                            .fields = &b->fields,
                                            .data = own};
    b->ahead_start = MPI_Wtime();
    kiln_points_ahead_start(&b->ahead, &result, b->prepared->threads);
}

/* kiln_beside */
static void pack_direct(void *context) { kiln_points_ahead_direct(((struct kiln_bake *)context)->ahead); }

/* kiln_beside */
static void stop_packing(void *context) { kiln_points_ahead_stop(((struct kiln_bake *)context)->ahead); }

int kiln_bake_settle_light(struct kiln_bake *b, struct kiln_error *error)
{
    b->light_settings = kiln_light_settings(b->job, b->prepared->lights, b->prepared->surface->point_count);
    const int status = settle_paths(b, error);
    if (status != KILN_OK)
        return status;
    b->probe_settings = b->light_settings;
    kiln_field_set_choose(&b->fields, b->job);
    b->beside = (struct kiln_beside){.start = pack_ahead, .direct = pack_direct, .stop = stop_packing, .context = b};
    b->denoised = (struct kiln_denoised_sample){.communicator = b->communicator,
                                                .scene = b->prepared->scene,
                                                .geometry = b->prepared->geometry,
                                                .backend = b->prepared->backend,
                                                .area = b->prepared->surface_report.geometry_area};
    b->denoising = (struct kiln_denoising){.run = kiln_denoised_sample_run, .context = &b->denoised};
    b->listener = (struct kiln_round_listener){.first_round = kiln_bake_expect_again, .context = b};
    b->light_params = (struct kiln_integrate_params){.communicator = b->communicator,
                                                     .rank = b->rank,
                                                     .ranks = b->prepared->ranks,
                                                     .begin = b->begin,
                                                     .after_light = kiln_reckon_after(&b->prepared->expected),
                                                     .rounds = b->prepared->foretold.samples,
                                                     .listener = &b->listener,
                                                     .settings = &b->light_settings,
                                                     .fields = &b->fields,
                                                     .backend = b->prepared->backend,
                                                     .surface = b->prepared->surface,
                                                     .seen = b->visible.seen,
                                                     .node = b->prepared->node,
                                                     .area = b->prepared->surface_report.geometry_area,
                                                     .trace = b->trace,
                                                     .emission = &b->emission,
                                                     .progress = b->progress,
                                                     .control = b->control,
                                                     .checkpoint = b->checkpoint,
                                                     .identity = b->identity,
                                                     .companions = kiln_companions,
                                                     .groups = b->groups.count > 0 ? &b->groups : NULL,
                                                     .transport = b->transport.is_on ? &b->transport : NULL,
                                                     .threads = b->prepared->threads,
                                                     .beside = &b->beside,
                                                     .denoising = kiln_job_denoises(b->job) ? &b->denoising : NULL};
    return KILN_OK;
}

/* Collective. */
static int expect_volume(struct kiln_bake *b, struct kiln_error *error)
{
    const uint32_t samples = b->job->volume.samples;
    const int status = samples != 0 && !b->same_probes
                           ? kiln_volume_expect(&b->light_settings, b->prepared->backend, samples, error)
                           : KILN_OK;
    return kiln_agree(b->communicator, status, error);
}

/* Turns caustics off for probes too, if the first round has left them out. */
static void settle_probes(struct kiln_bake *b)
{
    if (kiln_caustics_found(&b->solution->report.steps).left_out)
        b->probe_settings.caustics = KILN_CAUSTICS_NONE;
}

int kiln_bake_light(struct kiln_bake *b, struct kiln_error *error)
{
    int status = find_visible(b, error);
    if (status != KILN_OK)
        return status;
    kiln_phase(&b->phases, "emission");
    kiln_progress_phase(b->progress, "emission", 0);
    status = kiln_trace_emission(b->communicator, b->prepared->backend, &b->emission, error);
    status = kiln_bake_end_phase(b, status, error);
    if (status != KILN_OK)
        return status;
    status = kiln_bake_groups_sort(b, error);
    if (status == KILN_OK)
        status = kiln_bake_transport_begin(b, error);
    if (status != KILN_OK)
        return status;
    kiln_control_saved(b->control, kiln_checkpoint_generation(b->checkpoint), 0.0,
                       kiln_checkpoint_written(b->checkpoint));
    status = kiln_bake_settle_light(b, error);
    if (status == KILN_OK)
        status = expect_volume(b, error);
    if (status != KILN_OK)
        return status;
    b->saves = true;
    kiln_progress_phase(b->progress, KILN_STAGE_LIGHT, 0);
    status = kiln_integrate(&b->solution, &b->light_params, error);
    if (b->solution != NULL && b->light_settings.reference != NULL)
        b->solution->report.landing.radius = b->paths.radius;
    KILN_TRY(status);
    add_light_phases(b);
    settle_probes(b);
    if (b->solution->own->seen != NULL)
        kiln_visible_from_leave_seen(&b->solution->own->surface, b->solution->own->seen);
end:
    return status;
}

int kiln_bake_check_density(struct kiln_bake *b, struct kiln_error *error)
{
    if (!b->job->lightmaps.check_density || !(b->solution->report.energy.emitted[1] > 0.0))
        return KILN_OK;
    kiln_phase(&b->phases, "texel density");
    kiln_progress_phase(b->progress, "texel density", 0);
    const int status = kiln_density_check_run(&b->density, b->prepared, b->job, &b->light_params, b->solution, error);
    kiln_phase(&b->phases, NULL);
    return status;
}

/* kiln_volume_save */
static int save_volume(void *context, const struct kiln_array_range *blocks, size_t count, bool stop,
                       struct kiln_error *error)
{
    struct kiln_bake *b = context;
    const int status = kiln_integrate_save(b->solution, &b->light_params, blocks, count, error);
    return status == KILN_OK && stop ? kiln_stopped(b->control, error) : status;
}

/* Implements kiln_volume_save for relit states: saves nothing, since they have no checkpoint to resume from. */
static int save_nothing(void *context, const struct kiln_array_range *blocks, size_t count, bool stop,
                        struct kiln_error *error)
{
    (void)context;
    (void)blocks;
    (void)count;
    return stop ? kiln_give_up(error) : KILN_OK;
}

static struct kiln_volume_params volume_params(struct kiln_bake *b)
{
    const bool of_states = b->job->relighting.states != NULL || b->job->relighting.listen;
    return (struct kiln_volume_params){.communicator = b->communicator,
                                       .backend = b->prepared->backend,
                                       .scene = b->prepared->scene,
                                       .geometry = b->prepared->geometry,
                                       .radiosity = b->solution->radiosity,
                                       .spacing = b->job->volume.spacing,
                                       .bounds = b->job->volume.bounds,
                                       .samples = b->job->volume.samples,
                                       .light = &b->probe_settings,
                                       .progress = b->progress,
                                       .control = b->control,
                                       .checkpoint = b->checkpoint,
                                       .restore = b->same_probes && !of_states,
                                       .save = of_states ? save_nothing : save_volume,
                                       .context = b};
}

int kiln_bake_volume(struct kiln_bake *b, struct kiln_error *error)
{
    if (b->job->volume.samples == 0)
        return KILN_OK;
    kiln_phase(&b->phases, "probes");
    struct kiln_volume_params params = volume_params(b);
    struct kiln_group_light *groups = NULL;
    int status = KILN_OK;
    if (b->light_params.groups != NULL)
        status = kiln_group_light_create(&groups, &b->light_params, b->solution, error);
    if (groups != NULL) {
        params.groups = kiln_group_light_total(groups);
        params.group_names = b->job->scene.group_names;
    }
    if (status == KILN_OK)
        status = kiln_volume_run(&b->volume, &params, &b->probe_rays, error);
    kiln_group_light_destroy(&groups);
    kiln_phase(&b->phases, NULL);
    return status;
}

int kiln_bake_save(struct kiln_bake *b, struct kiln_error *error)
{
    const struct kiln_volume_params params = volume_params(b);
    if (b->job->volume.samples != 0)
        return kiln_volume_save_all(&b->volume, &params, &b->probe_rays, error);
    return save_volume(b, NULL, 0, true, error);
}
