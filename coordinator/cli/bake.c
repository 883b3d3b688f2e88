/* kiln bake: from the scene to the output files. */
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "coordinator/bake/identity.h"
#include "coordinator/bake/light_settings.h"
#include "coordinator/bake/run_report.h"
#include "coordinator/bake/run_table.h"
#include "coordinator/bake/volume.h"
#include "coordinator/mpi/agree.h"
#include "coordinator/cli/commands.h"
#include "coordinator/files/json.h"
#include "coordinator/files/output_name.h"
#include "coordinator/run/process.h"
#include "coordinator/export/export.h"
#include "coordinator/output/manifest.h"
#include "coordinator/files/publish.h"
#include "coordinator/view/view.h"
#include "worker/base/calls.h"
#include "worker/base/memory.h"
#include "worker/base/text.h"

struct bake {
    struct kiln_job *job;
    MPI_Comm communicator;
    int rank;
    bool made_folder; /* rank 0: this bake has created the output folder */
    char scene_file[KILN_PATH_SIZE];
    double begin;
    struct kiln_phases phases;
    struct kiln_trace *trace;       /* NULL: none */
    struct kiln_watchdog *watchdog; /* NULL: none */
    struct kiln_control *control;
    struct kiln_checkpoint *checkpoint;
    json_t *identity;
    struct kiln_progress *progress;
    struct kiln_prepared *prepared;
    struct kiln_emission_result emission;
    struct kiln_integrate_settings light_settings;
    struct kiln_field_set fields;
    struct kiln_integrate_params light_params;
    struct kiln_solution *solution;
    struct kiln_volume_result volume;
    struct kiln_lightmap_report *lightmaps;
    uint64_t probe_rays;
    bool same_probes; /* the probes of the checkpoint can be used */
    bool saves;       /* in passes and in the probe pass, where stopping writes a checkpoint */
    bool light_done;  /* everything is done except writing the files */
    json_t *preview;  /* rank 0: its camera and exposure; NULL: none */
    char preview_text[KILN_VIEWPOINT_TEXT];
    bool exported;  /* scene.glb has been written */
    json_t *report; /* rank 0: content of run.json */
};

static int make_folder(struct bake *b, struct kiln_error *error)
{
    int status = kiln_path_join(b->scene_file, b->job->output, "scene.kscene", error);
    if (status == KILN_OK && b->rank == 0) {
        struct stat there;
        b->made_folder = stat(b->job->output, &there) != 0;
        status = kiln_make_directories(b->job->output, error);
    }
    return kiln_agree(b->communicator, status, error);
}

/* Removes the output folder if this bake has created it and it is empty, so that a refused scene leaves nothing. */
static void forget_folder(const struct bake *b)
{
    if (b->rank == 0 && b->made_folder)
        (void)rmdir(b->job->output);
}

static int make_lightmap_folder(struct bake *b, struct kiln_error *error)
{
    struct kiln_folder folder;
    int status = KILN_OK;
    if (b->rank == 0) {
        status = kiln_folder_open(&folder, b->job->output, "lightmaps", true, error);
        kiln_folder_close(&folder);
    }
    return kiln_agree(b->communicator, status, error);
}

/* Rank 0. Removes files of an earlier bake that this one will not replace. The manifest of that bake lists them. */
static int remove_stale(const struct bake *b, struct kiln_error *error)
{
    struct kiln_pruned pruned;
    const struct kiln_manifest_parts parts = {
        .volume = b->job->samples_probe != 0, .preview = b->job->preview, .scene = b->job->export};
    const int status =
        kiln_manifest_prune(b->job->output, b->prepared->scene, b->prepared->surface, &parts, &pruned, error);
    if (status == KILN_OK && pruned.removed > 0 && !b->job->quiet)
        (void)fprintf(stderr, "kiln: removed %zu file%s of the previous bake that this one does not write\n",
                      pruned.removed, pruned.removed == 1 ? "" : "s");
    if (status == KILN_OK && pruned.kept > 0)
        kiln_print(stderr,
                   "kiln: note: %zu file%s of the previous bake %s changed since, and left in place: %s first\n",
                   pruned.kept, pruned.kept == 1 ? "" : "s", pruned.kept == 1 ? "was" : "were", pruned.first_kept);
    return status;
}

/* Removes the manifest and run.json of an earlier bake before any of its results is replaced, since they would no
 * longer be true. */
static int forget_old_report(struct bake *b, struct kiln_error *error)
{
    int status = KILN_OK;
    if (b->rank == 0) {
        status = kiln_control_check_folder(b->control, error);
        if (status == KILN_OK)
            status = kiln_scene_check_unchanged(b->prepared->scene, b->scene_file, error);
        if (status == KILN_OK)
            status = remove_stale(b, error);
        if (status == KILN_OK)
            status = kiln_manifest_remove(b->job->output, error);
        if (status == KILN_OK && kiln_unlink_below(b->job->output, "run.json") != 0 && errno != ENOENT)
            status = kiln_fail_errno(error, KILN_CANNOT_CREATE, "cannot replace %s/run.json", b->job->output);
    }
    return kiln_agree(b->communicator, status, error);
}

/* Locks the output folder and opens the checkpoint, which determines the instruction set unless the job does. */
static int take_charge(struct bake *b, struct kiln_error *error)
{
    const struct kiln_control_params params = {.communicator = b->communicator,
                                               .directory = b->job->output,
                                               .begin = b->begin,
                                               .max_time = b->job->max_time,
                                               .checkpoint_every = b->job->checkpoint_every,
                                               .watchdog = b->watchdog,
                                               .limit = b->job->watchdog,
                                               .no_locks = b->job->faults.no_locks,
                                               .signal = kiln_process_signal()};
    int status = kiln_control_create(&b->control, &params, error);
    if (status != KILN_OK)
        return status;
    kiln_control_follow(b->control, b->progress);
    return kiln_checkpoint_open(&b->checkpoint, b->communicator, b->job->output, b->job->resume, error);
}

/* Drops the timeline if another bake is at work in the folder. */
static int drop_trace(struct bake *b, int status)
{
    kiln_trace_destroy(&b->trace);
    b->phases.trace = NULL;
    return status;
}

/* Collective. Checks, before any work, that the results and the timeline can be written. */
static int check_outputs(struct bake *b, struct kiln_error *error)
{
    static const struct kiln_manifest_parts all = {.volume = true, .preview = true, .scene = true};
    const struct kiln_output_name trace = {.option = "--trace",
                                           .path = b->job->trace,
                                           .inputs = {b->job->scene, b->job->arguments[0], b->job->environment},
                                           .bakes = {b->job->output}};
    int status = KILN_OK;
    if (b->rank == 0) {
        status = kiln_manifest_look(b->job->output, NULL, NULL, &all, error);
        if (status == KILN_OK && b->job->trace != NULL)
            status = kiln_output_name_check(&trace, error);
    }
    status = kiln_agree(b->communicator, status, error);
    return status == KILN_OK ? KILN_OK : drop_trace(b, status);
}

/* Rank 0. Checks that each lightmap can be written. */
static int check_lightmaps(const struct bake *b, const struct kiln_prepared *p, struct kiln_error *error)
{
    const struct kiln_manifest_parts parts = {
        .volume = b->job->samples_probe != 0, .preview = b->job->preview, .scene = b->job->export};
    return kiln_manifest_look(b->job->output, p->scene, p->surface, &parts, error);
}

/* Prints the notes of the importer. */
static void say_notes(const struct kiln_scene *scene)
{
    for (size_t i = 0; i < scene->note_count; i++)
        if (scene->notes[i].severity == KILN_NOTE_REPEATED)
            kiln_print(stderr, "kiln: note: %s\n", kiln_scene_string(scene, scene->notes[i].text));
}

/* Compares the bake with its checkpoint, and prints which checkpoint it continues. */
static int compare_with_checkpoint(struct bake *b, const struct kiln_prepared *prepared, struct kiln_error *error)
{
    char note[400];
    b->identity = kiln_identity_make(b->job, prepared);
    int status = kiln_agree(
        b->communicator,
        b->identity != NULL ? KILN_OK : kiln_fail(error, KILN_SYSTEM, "out of memory: the bake's identity"), error);
    if (status == KILN_OK && !b->job->resume)
        kiln_checkpoint_remove(b->checkpoint);
    if (status != KILN_OK || kiln_checkpoint_generation(b->checkpoint) == 0)
        return status;
    status = kiln_identity_compare(kiln_checkpoint_identity(b->checkpoint), b->identity, b->job->output, note,
                                   sizeof note, error);
    b->same_probes = kiln_identity_same_probes(kiln_checkpoint_identity(b->checkpoint), b->identity);
    if (status != KILN_OK || b->rank != 0 || b->job->quiet)
        return status;
    char age[48];
    const double written = kiln_checkpoint_written(b->checkpoint);
    (void)fprintf(stderr,
                  "kiln: going on from checkpoint %llu, written %s ago (--no-resume would start from the beginning)\n",
                  (unsigned long long)kiln_checkpoint_generation(b->checkpoint),
                  kiln_duration_text((double)time(NULL) - written, age, sizeof age));
    if (note[0] != '\0')
        kiln_print(stderr, "kiln: note: %s\n", note);
    if (!b->same_probes && b->job->samples_probe != 0 && kiln_checkpoint_has(b->checkpoint, "probes"))
        (void)fprintf(stderr, "kiln: note: the checkpoint's probes are of other settings (--probe-spacing, "
                              "--samples-probe): they are gathered again, "
                              "the light on surfaces is not\n");
    return status;
}

/* Rank 0. Checks that the memory of this host can hold the probes, and the disk the results. */
static int check_room(const struct bake *b, const struct kiln_prepared *p, const struct kiln_volume_result *volume,
                      struct kiln_error *error)
{
    const double memory = (double)sysconf(_SC_PHYS_PAGES) * (double)sysconf(_SC_PAGESIZE);
    const uint64_t probes = volume->size[0] * volume->size[1] * volume->size[2];
    const double needed = (double)probes / p->ranks * p->node_ranks * (double)sizeof(struct kiln_probe_result);
    if (memory > 0.0 && needed > memory)
        return kiln_fail(
            error, KILN_SYSTEM,
            "%llu probes take %.1f GiB on this host, which has %.1f GiB: use a larger --probe-spacing, or more hosts",
            (unsigned long long)probes, needed / 0x1p30, memory / 0x1p30);
    if (p->surface == NULL)
        return KILN_OK;
    struct kiln_field_set fields;
    kiln_field_set_choose(&fields, b->job);
    return kiln_require_space(
        b->job->output, kiln_h5_space(p->scene, p->surface, &fields) + (probes > 0 ? kiln_volume_space(volume) : 0),
        error);
}

/* kiln_prepare_care.refuse: refuses whatever can be refused before the first ray. */
static int look_ahead(void *context, const struct kiln_prepared *p, struct kiln_error *error)
{
    struct bake *b = context;
    struct kiln_volume_result volume = {0};
    int status =
        b->job->samples_probe != 0 ? kiln_volume_grid(&volume, p->scene, b->job->probe_spacing, error) : KILN_OK;
    if (status == KILN_OK && b->rank == 0 && p->surface != NULL)
        status = check_lightmaps(b, p, error);
    status = kiln_agree(b->communicator, status, error);
    if (status == KILN_OK && p->surface != NULL)
        status = compare_with_checkpoint(b, p, error);
    if (status == KILN_OK) /* a checkpoint that --no-resume discards has been removed by now */
        status = kiln_agree(b->communicator, b->rank == 0 ? check_room(b, p, &volume, error) : KILN_OK, error);
    return status;
}

/* Continues with the instruction set of the checkpoint if all ranks have it, to keep the bits of the bake. */
static int prepare(struct bake *b, struct kiln_error *error)
{
    const char *before = kiln_identity_instruction_set(kiln_checkpoint_identity(b->checkpoint));
    const bool pin = b->job->instruction_set == NULL && before != NULL;
    struct kiln_job job = *b->job;
    if (pin && kiln_instruction_set_common(b->communicator, before))
        job.instruction_set = (char *)(uintptr_t)before;
    const struct kiln_prepare_care care = {.control = b->control, .refuse = look_ahead, .context = b};
    const int status =
        kiln_prepare(&b->prepared, b->communicator, &job, b->scene_file, &b->phases, b->progress, &care, error);
    if (status == KILN_OK && b->rank == 0 && !b->job->quiet)
        say_notes(b->prepared->scene);
    return status;
}

/* Collective. Agrees on errors at the end of a phase. Time spent waiting for other ranks does not count for the phase.
 */
static int agree_after_phase(struct bake *b, int status, struct kiln_error *error)
{
    kiln_phase(&b->phases, "waiting");
    kiln_control_meet(b->control);
    status = kiln_agree(b->communicator, status, error);
    kiln_phase(&b->phases, NULL);
    return status;
}

/* Adds the times of the steps to the phases of their roles. */
static void add_light_phases(struct bake *b)
{
    const struct kiln_integrate_report *report = &b->solution->report;
    const struct kiln_integrator *integrator = report->integrator;
    for (uint32_t r = 0; r < integrator->role_count; r++)
        kiln_phase_add(&b->phases, integrator->roles[r].phase, 0.0);
    kiln_phase_add(&b->phases, "exchange", 0.0);
    kiln_phase_add(&b->phases, "waiting", report->waiting_seconds);
    for (size_t i = 0; i < report->steps.count; i++) {
        const struct kiln_step_report *step = &report->steps.of[i];
        kiln_phase_add(&b->phases, integrator->roles[step->step.role].phase, step->seconds);
        kiln_phase_add(&b->phases, "exchange", step->exchange_seconds);
    }
}

static int integrate_light(struct bake *b, struct kiln_error *error)
{
    kiln_phase(&b->phases, "emission");
    kiln_progress_phase(b->progress, "emission", 0);
    int status = kiln_backend_emission(b->prepared->backend, KILN_EMISSION_SAMPLES, &b->emission, error);
    status = agree_after_phase(b, status, error);
    if (status != KILN_OK)
        return status;
    kiln_control_saved(b->control, kiln_checkpoint_generation(b->checkpoint), 0.0,
                       kiln_checkpoint_written(b->checkpoint));
    b->light_settings = kiln_light_settings(b->job, b->prepared->surface->point_count);
    kiln_field_set_choose(&b->fields, b->job);
    b->light_params = (struct kiln_integrate_params){.communicator = b->communicator,
                                                     .rank = b->rank,
                                                     .ranks = b->prepared->ranks,
                                                     .begin = b->begin,
                                                     .settings = &b->light_settings,
                                                     .fields = &b->fields,
                                                     .backend = b->prepared->backend,
                                                     .surface = b->prepared->surface,
                                                     .node = b->prepared->node,
                                                     .area = b->prepared->surface_report.geometry_area,
                                                     .trace = b->trace,
                                                     .emission = &b->emission,
                                                     .progress = b->progress,
                                                     .control = b->control,
                                                     .checkpoint = b->checkpoint,
                                                     .identity = b->identity,
                                                     .threads = b->prepared->threads};
    b->saves = true;
    status = kiln_integrate(&b->solution, &b->light_params, error);
    if (status == KILN_OK)
        add_light_phases(b);
    return status;
}

/* kiln_volume_save */
static int save_volume(void *context, const struct kiln_block *blocks, size_t count, bool stop,
                       struct kiln_error *error)
{
    struct bake *b = context;
    const int status = kiln_integrate_save(b->solution, &b->light_params, blocks, count, error);
    return status == KILN_OK && stop ? kiln_stopped(b->control, error) : status;
}

static struct kiln_volume_params volume_params(struct bake *b)
{
    return (struct kiln_volume_params){.communicator = b->communicator,
                                       .backend = b->prepared->backend,
                                       .scene = b->prepared->scene,
                                       .radiosity = b->solution->radiosity,
                                       .spacing = b->job->probe_spacing,
                                       .samples = b->job->samples_probe,
                                       .progress = b->progress,
                                       .control = b->control,
                                       .checkpoint = b->checkpoint,
                                       .restore = b->same_probes,
                                       .save = save_volume,
                                       .context = b};
}

static int gather_volume(struct bake *b, struct kiln_error *error)
{
    if (b->job->samples_probe == 0)
        return KILN_OK;
    kiln_phase(&b->phases, "probes");
    const struct kiln_volume_params params = volume_params(b);
    const int status = kiln_volume_run(&b->volume, &params, &b->probe_rays, error);
    kiln_phase(&b->phases, NULL);
    return status;
}

static int write_points(struct bake *b, const struct kiln_bake_result *result, const struct kiln_output_params *params,
                        struct kiln_error *error)
{
    (void)b;
    return kiln_write_h5(result, params, error);
}

static int write_volume(struct bake *b, const struct kiln_bake_result *result, const struct kiln_output_params *params,
                        struct kiln_error *error)
{
    return kiln_write_volume(result, &b->volume, params, error);
}

/* Collective. Writes a file and, if that fails, writes it once more from the beginning. MPI-IO reports an interrupted
 * system call as a failure, or even as a success, which reading back reveals; only a second failure is final. */
static int write_twice(struct bake *b, const struct kiln_bake_result *result, const struct kiln_output_params *params,
                       int (*write)(struct bake *, const struct kiln_bake_result *, const struct kiln_output_params *,
                                    struct kiln_error *),
                       struct kiln_error *error)
{
    int status = write(b, result, params, error);
    if (status != KILN_IO && status != KILN_CANNOT_CREATE)
        return status;
    const struct kiln_error first = *error;
    status = write(b, result, params, error);
    if (status == KILN_OK && b->rank == 0)
        (void)fprintf(stderr, "kiln: warning: %s; the second attempt succeeded\n", first.message);
    return status;
}

static int write_results(struct bake *b, const char *provenance, struct kiln_error *error)
{
    const struct kiln_node_data *data = b->solution->node_data;
    const struct kiln_bake_result result = {.units = kiln_units_of(b->job->units, b->prepared->scene),
                                            .communicator = b->communicator,
                                            .scene = b->prepared->scene,
                                            .geometry = b->prepared->geometry,
                                            .surface = b->prepared->surface,
                                            .fields = kiln_node_data_fields(data),
                                            .data = kiln_rank_data(data, kiln_node_data_own(data)),
                                            .radiosity = b->solution->radiosity,
                                            .stop = kiln_control_stop(b->control)};
    const struct kiln_output_params params = {.directory = b->job->output,
                                              .half = b->job->half,
                                              .stitch = b->job->stitch,
                                              .denoise = kiln_job_denoises(b->job),
                                              .faults = &b->job->faults,
                                              .provenance_json = provenance};
    kiln_phase(&b->phases, "lightmaps");
    kiln_progress_phase(b->progress, "lightmaps", 0);
    int status = kiln_allocate(&b->lightmaps, b->prepared->surface->map_count, sizeof *b->lightmaps,
                               "the lightmaps' report", error);
    status = kiln_agree(b->communicator, status, error);
    if (status == KILN_OK)
        status = kiln_write_lightmaps(&result, &params, b->lightmaps, error);
    if (status == KILN_OK) {
        kiln_phase(&b->phases, "kiln.h5");
        kiln_progress_phase(b->progress, "kiln.h5", 0);
        status = write_twice(b, &result, &params, write_points, error);
    }
    if (status == KILN_OK && b->job->samples_probe != 0) {
        kiln_phase(&b->phases, "volume.hdf");
        kiln_progress_phase(b->progress, "volume.hdf", 0);
        status = write_twice(b, &result, &params, write_volume, error);
    }
    kiln_phase(&b->phases, NULL);
    return status;
}

static int draw_picture(struct bake *b, struct kiln_error *error)
{
    const struct kiln_prepared *p = b->prepared;
    const struct kiln_view_source source = {.directory = b->job->output,
                                            .scene = p->scene,
                                            .geometry = p->geometry,
                                            .lights = p->lights,
                                            .backend = p->backend,
                                            .stop = kiln_control_stop(b->control)};
    const struct kiln_view_wish wish = {0};
    struct kiln_picture picture = {0};
    int status = kiln_picture_make(&source, &wish, 2, &picture, error);
    if (status == KILN_OK)
        status = kiln_picture_write(b->job->output, "preview.png", &picture, b->job->exposure, error);
    if (status == KILN_OK)
        b->preview = kiln_picture_json(&picture, b->job->exposure);
    if (status == KILN_OK && !b->job->quiet) {
        kiln_viewpoint_text(&picture.viewpoint, b->preview_text);
    }
    kiln_image_destroy(&picture.image);
    return status;
}

static int draw_preview(struct bake *b, struct kiln_error *error)
{
    if (!b->job->preview)
        return KILN_OK;
    kiln_phase(&b->phases, "preview");
    kiln_progress_phase(b->progress, "preview", 0);
    int status = KILN_OK;
    if (b->rank == 0)
        status = draw_picture(b, error);
    return agree_after_phase(b, status, error);
}

static int export_beside(const struct bake *b, struct kiln_error *error)
{
    const struct kiln_surface *s = b->prepared->surface;
    char path[KILN_PATH_SIZE];
    struct stat source, there;
    uint8_t *backs = NULL;
    int status = kiln_path_join(path, b->job->output, "scene.glb", error);
    if (status == KILN_OK && stat(b->job->scene, &source) == 0 && stat(path, &there) == 0 &&
        source.st_dev == there.st_dev && source.st_ino == there.st_ino)
        return kiln_fail(error, KILN_BAD_INPUT, "%s is the scene itself; kiln export writes it to another folder",
                         path);
    /* remove that of an earlier bake, which links to lightmaps that no longer exist */
    if (status == KILN_OK && kiln_unlink_below(b->job->output, "scene.glb") != 0 && errno != ENOENT)
        status = kiln_fail_errno(error, KILN_CANNOT_CREATE, "cannot replace %s", path);
    if (status == KILN_OK)
        status = kiln_allocate(&backs, s->object_count, 1, "the export's links", error);
    for (uint32_t i = s->object_count; status == KILN_OK && i < s->map_count; i++)
        backs[i - s->object_count] = s->lightmaps[i].published != 0;
    if (status == KILN_OK)
        status = kiln_export_beside(b->job->output, b->job->scene, b->prepared->scene, backs,
                                    kiln_units_of(b->job->units, b->prepared->scene)->irradiance_text,
                                    kiln_control_stop(b->control), error);
    kiln_free(&backs);
    return status;
}

/* Writes scene.glb. If the source scene has been removed or changed meanwhile, or does not fit one glTF file, prints a
 * warning; the bake is still valid, and kiln export can write the scene later. */
static int write_scene(struct bake *b, struct kiln_error *error)
{
    int status = KILN_OK, told = 0;
    if (!b->job->export)
        return KILN_OK;
    kiln_phase(&b->phases, "scene.glb");
    kiln_progress_phase(b->progress, "scene.glb", 0);
    if (b->rank == 0) {
        struct kiln_error own = {""};
        status = export_beside(b, &own);
        told = status == KILN_BAD_INPUT || status == KILN_NO_INPUT || status == KILN_PERMISSION;
        if (told != 0)
            kiln_print(stderr, "kiln: warning: no scene.glb: %s\n", own.message);
        else if (status != KILN_OK)
            *error = own;
    }
    kiln_control_meet(b->control);
    (void)MPI_Bcast(&told, 1, MPI_INT, 0, b->communicator);
    b->exported = told == 0;
    return agree_after_phase(b, told != 0 ? KILN_OK : status, error);
}

/* Writes run.json, after everything that it names. */
static int write_report(struct bake *b, struct kiln_error *error)
{
    kiln_phase_rest(&b->phases, b->solution->report.seconds_before);
    const struct kiln_run run = {.job = b->job,
                                 .prepared = b->prepared,
                                 .solution = b->solution,
                                 .volume = &b->volume,
                                 .lightmaps = b->lightmaps,
                                 .phases = &b->phases,
                                 .probe_rays = b->probe_rays,
                                 .directory = b->job->output};
    int status = kiln_run_report(&b->report, &run, error);
    if (status == KILN_OK && b->rank == 0) {
        if (b->preview != NULL)
            (void)json_object_set(b->report, "preview", b->preview);
        char *text = json_dumps(b->report, JSON_INDENT(2));
        status = text == NULL ? kiln_fail(error, KILN_SYSTEM, "out of memory: run.json")
                              : kiln_publish_bytes_below(b->job->output, "run.json", text, strlen(text), error);
        free(text);
    }
    return kiln_agree(b->communicator, status, error);
}

/* Writes the manifest, last of all, since it lists run.json too. */
static int write_manifest(struct bake *b, struct kiln_error *error)
{
    kiln_progress_phase(b->progress, "manifest", 0);
    const struct kiln_manifest_parts parts = {
        .volume = b->job->samples_probe != 0, .preview = b->job->preview, .scene = b->exported};
    const int status =
        kiln_manifest_write(b->communicator, b->job->output, b->prepared->scene, b->prepared->surface, &parts, error);
    kiln_progress_finish(b->progress);
    return status;
}

/* Rank 0. Prints the results, when nothing can fail any more. */
static int print_results(const struct bake *b, struct kiln_error *error)
{
    if (b->job->json)
        return kiln_json_print(json_incref(b->report), error);
    if (!b->job->quiet)
        kiln_run_table(stdout, b->report);
    if (!b->job->json && !b->job->quiet && b->preview_text[0] != '\0')
        kiln_print(stdout, "preview.png  %s\n", b->preview_text);
    return KILN_OK;
}

/* Adds the time spent on checkpoints to the phases. */
static void note_checkpoints(struct bake *b)
{
    uint64_t count, bytes;
    double seconds;
    kiln_checkpoint_spent(b->checkpoint, &count, &seconds, &bytes);
    if (count > 0) /* the same on all ranks */
        kiln_phase_add(&b->phases, "checkpoints", seconds);
}

static int run_phases(struct bake *b, struct kiln_error *error)
{
    int status = prepare(b, error);
    if (status == KILN_OK)
        status = integrate_light(b, error);
    if (status == KILN_OK)
        status = gather_volume(b, error);
    if (status != KILN_OK)
        return status;
    b->light_done = true;
    note_checkpoints(b);
    status = forget_old_report(b, error);
    if (status == KILN_OK)
        status = make_lightmap_folder(b, error);
    if (status != KILN_OK)
        return status;
    char *provenance = kiln_provenance(b->job, b->prepared);
    status =
        kiln_agree(b->communicator,
                   provenance != NULL ? KILN_OK : kiln_fail(error, KILN_SYSTEM, "out of memory: provenance"), error);
    if (status == KILN_OK)
        status = write_results(b, provenance, error);
    free(provenance);
    if (status == KILN_OK)
        status = write_scene(b, error);
    if (status == KILN_OK)
        status = draw_preview(b, error);
    if (status == KILN_OK)
        status = write_report(b, error);
    return status == KILN_OK ? write_manifest(b, error) : status;
}

/* Collective, after KILN_STOPPED. Saves what has been computed and composes the message. A bake that was stopped within
 * a pass or the probe pass has done so already; here either nothing has been computed yet, or only files are missing.
 */
static int end_early(struct bake *b, struct kiln_error *error)
{
    kiln_phase(&b->phases, NULL);
    if (!b->light_done && b->saves)
        return KILN_STOPPED;
    kiln_control_why(b->control);
    if (!b->light_done)
        return kiln_stopped_early(b->control, b->job->resume ? kiln_checkpoint_generation(b->checkpoint) : 0, error);
    const struct kiln_volume_params params = volume_params(b);
    if (b->job->samples_probe != 0)
        return kiln_volume_save_all(&b->volume, &params, &b->probe_rays, error);
    return save_volume(b, NULL, 0, true, error);
}

static int run(struct bake *b, struct kiln_error *error)
{
    int status = make_folder(b, error);
    if (status == KILN_OK)
        status = take_charge(b, error);
    status = status == KILN_OK ? check_outputs(b, error) : drop_trace(b, status);
    if (status == KILN_OK)
        status = run_phases(b, error);
    return status == KILN_STOPPED ? end_early(b, error) : status;
}

/* Writes the final status, which is kept as long as there is a checkpoint to continue from. */
static void conclude(struct bake *b, int status, const struct kiln_error *error)
{
    uint64_t generation;
    const bool there = kiln_checkpoint_newest(b->job->output, &generation);
    kiln_control_conclude(b->control, status, status == KILN_OK ? "" : error->message, status == KILN_OK || !there);
}

/* Collective. Writes the timeline, also of a bake that failed; then the failure of the bake is the one reported. */
static int write_trace(struct bake *b, int status, struct kiln_error *error)
{
    if (b->trace == NULL)
        return status;
    struct kiln_error own;
    const int written = kiln_trace_write(b->trace, b->job->trace, &own);
    kiln_trace_destroy(&b->trace);
    b->phases.trace = NULL;
    if (status == KILN_OK && written != KILN_OK)
        *error = own;
    return status == KILN_OK ? written : status;
}

int kiln_command_bake(struct kiln_job *job, struct kiln_error *error)
{
    struct bake b = {.job = job, .communicator = MPI_COMM_WORLD};
    (void)MPI_Comm_rank(b.communicator, &b.rank);
    b.begin = MPI_Wtime();
    b.progress = b.rank == 0 && job->quiet ? kiln_progress_create_silent() : kiln_progress_create(job->quiet, b.rank);
    kiln_phase(&b.phases, NULL);
    int status = kiln_watchdog_create(&b.watchdog, b.communicator, job->watchdog,
                                      kiln_faults_halt(&job->faults, (uint32_t)b.rank), error);
    if (status == KILN_OK && job->trace != NULL)
        status = kiln_trace_create(&b.trace, b.communicator, error);
    b.phases.watchdog = b.watchdog;
    b.phases.trace = b.trace;
    if (status == KILN_OK)
        status = run(&b, error);
    status = write_trace(&b, status, error);
    if (status == KILN_OK)
        status = kiln_agree(b.communicator, b.rank == 0 ? print_results(&b, error) : KILN_OK, error);
    if (b.checkpoint != NULL && status == KILN_OK)
        kiln_checkpoint_remove(b.checkpoint); /* run.json is complete, so the checkpoint is no longer needed */
    if (b.control != NULL)
        conclude(&b, status, error);
    if (status != KILN_OK)
        forget_folder(&b);
    kiln_process_release();
    kiln_progress_observe(b.progress, NULL, NULL);
    kiln_control_destroy(&b.control);
    kiln_checkpoint_close(&b.checkpoint);
    json_decref(b.identity);
    json_decref(b.report);
    json_decref(b.preview);
    kiln_progress_destroy(&b.progress);
    kiln_free(&b.lightmaps);
    kiln_volume_destroy(&b.volume);
    kiln_solution_destroy(&b.solution);
    kiln_prepared_destroy(&b.prepared);
    kiln_watchdog_destroy(&b.watchdog); /* last, so that the watchdog also watches the collective calls above */
    return status;
}
