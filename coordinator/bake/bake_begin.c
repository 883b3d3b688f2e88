#include <math.h>
#include <stdio.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "coordinator/bake/bake_private.h"
#include "coordinator/bake/points/enclosed_lights.h"
#include "coordinator/integrate/patches/link_file.h"
#include "coordinator/bake/identity/identity.h"
#include "coordinator/bake/prepare/materials.h"
#include "coordinator/bake/prepare/results_memory.h"
#include "coordinator/bake/prepare/stages.h"
#include "coordinator/bake/report/run_report.h"
#include "coordinator/bake/identity/transport_identity.h"
#include "coordinator/files/publish.h"
#include "coordinator/mpi/agree.h"
#include "coordinator/output/manifest.h"
#include "coordinator/run/checkpoint_local.h"
#include "coordinator/run/process.h"
#include "worker/backend/extended.h"
#include "worker/base/text.h"

int kiln_bake_take_charge(struct kiln_bake *b, struct kiln_error *error)
{
    const struct kiln_control_params params = {.communicator = b->communicator,
                                               .directory = b->job->output,
                                               .begin = b->begin,
                                               .max_time = b->job->checkpoints.max_time,
                                               .checkpoint_every = b->job->checkpoints.every,
                                               .watchdog = b->watchdog,
                                               .limit = b->job->checkpoints.watchdog,
                                               .no_locks = b->job->faults.no_locks,
                                               .halt = kiln_faults_halt(&b->job->faults, (uint32_t)b->rank),
                                               .signal = kiln_process_signal()};
    int status =
        kiln_agree(b->communicator, kiln_path_join(b->scene_file, b->job->output, "scene.kscene", error), error);
    if (status == KILN_OK)
        status = kiln_control_create(&b->control, &params, error);
    if (status != KILN_OK)
        return status;
    if (b->rank == 0)
        kiln_bake_keep_scene(b);
    const char *local = b->job->checkpoints.local;
    kiln_control_follow(b->control, b->progress);
    if (local != NULL && b->job->checkpoints.resume)
        status = kiln_checkpoint_bring_home(b->communicator, b->job->output, local, error);
    if (status == KILN_OK)
        status =
            kiln_checkpoint_open(&b->checkpoint, b->communicator, b->job->output, b->job->checkpoints.resume, error);
    if (status == KILN_OK && local != NULL)
        status = kiln_checkpoint_write_locally(b->checkpoint, local, error);
    return status;
}

/* Rank 0. Checks that each lightmap can be written. */
static int check_lightmaps(const struct kiln_bake *b, const struct kiln_prepared *p, struct kiln_error *error)
{
    const struct kiln_optional_results parts = {.volume = b->job->volume.samples != 0,
                                                .preview = b->job->preview,
                                                .scene = b->job->write_scene,
                                                .groups = b->job->scene.group_count};
    return kiln_manifest_look(b->job->output, p->scene, p->surface, &parts, error);
}

static void say_warnings(const struct kiln_prepared *prepared)
{
    json_t *warnings = kiln_scene_warnings(prepared);
    size_t index;
    const json_t *warning;
    json_array_foreach(warnings, index, warning) kiln_print(stderr, "kiln: note: %s\n", json_string_value(warning));
    json_decref(warnings);
}

/* Compares the bake with its checkpoint, and prints which checkpoint it continues. */
static int compare_with_checkpoint(struct kiln_bake *b, const struct kiln_prepared *prepared, struct kiln_error *error)
{
    char note[400];
    b->identity = kiln_identity_make(b->job, prepared);
    int status = kiln_agree(
        b->communicator,
        b->identity != NULL ? KILN_OK : kiln_fail(error, KILN_SYSTEM, "out of memory: the bake's identity"), error);
    if (status == KILN_OK && !b->job->checkpoints.resume)
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
    if (!b->same_probes && b->job->volume.samples != 0 && kiln_checkpoint_has(b->checkpoint, "probes"))
        (void)fprintf(stderr, "kiln: note: the checkpoint's probes are of other settings (--probe-spacing, "
                              "--volume-bounds, --samples-probe): they are gathered again, "
                              "the light on surfaces is not\n");
    return status;
}

/* Rank 0. Checks that the memory of this host can hold the probes, and the disk the results. */
static int check_room(const struct kiln_bake *b, const struct kiln_prepared *p, const struct kiln_volume_result *volume,
                      struct kiln_error *error)
{
    const double memory = (double)sysconf(_SC_PHYS_PAGES) * (double)sysconf(_SC_PAGESIZE);
    const uint64_t probes = volume->size[0] * volume->size[1] * volume->size[2];
    const double needed = (double)probes / p->ranks * p->node_ranks * (double)KILN_PROBE_BYTES;
    if (memory > 0.0 && needed > memory)
        return kiln_fail(
            error, KILN_SYSTEM,
            "%llu probes take %.1f GiB on this host, which has %.1f GiB: use a larger --probe-spacing, or more hosts",
            (unsigned long long)probes, needed / 0x1p30, memory / 0x1p30);
    if (p->surface == NULL)
        return KILN_OK;
    struct kiln_field_set fields;
    kiln_field_set_choose(&fields, b->job);
    /* kept transport of the last step only; the number of steps before it depends on the light */
    const uint64_t points = p->surface->point_count,
                   rows = b->job->light.keep == KILN_KEEP_ROWS
                              ? kiln_transport_bytes(points, b->job->light.samples_indirect,
                                                     kiln_transport_goes_on(b->job, p))
                          : b->job->light.keep == KILN_KEEP_LINKS
                              ? kiln_link_file_bytes_expected(points, b->job->light.patches.link_error)
                              : 0;
    return kiln_require_space(
        b->job->output,
        kiln_h5_space(p->scene, p->surface, &fields) + (probes > 0 ? kiln_volume_space(volume) : 0) + rows, error);
}

/* Makes the job a copy of its own, adapted to the materials of the scene. */
static void settle_materials(struct kiln_bake *b, const struct kiln_scene *scene)
{
    if (b->job != &b->settled) {
        b->materials = (enum kiln_gloss_mode)b->job->light.materials;
        b->settled = *b->job;
    }
    b->job = &b->settled;
    kiln_materials_settle(&b->settled, scene);
}

/* Settles a scene without any light: all light is 0, and nothing is traced. Transport to be kept for later lights is
 * still computed. */
static void settle_dark(struct kiln_bake *b, const struct kiln_prepared *p)
{
    struct kiln_job *job = &b->settled;
    if (p->lights == NULL || !kiln_lights_are_none(p->lights) || job->relighting.folder != NULL ||
        job->light.keep != KILN_KEEP_NONE)
        return;
    static char cells[] = "cells"; /* schedule without a step after direct light */
    job->light.method = cells;
    job->light.bounces = 0;
    job->light.tail = false;
    job->light.caustics = KILN_CAUSTICS_NONE;
    job->light.radiance.range = INFINITY;
    job->light.indirect_scale = job->light.final_scale = job->light.guide = 0;
    job->volume.samples = 0;
    job->lightmaps.denoise = KILN_DENOISE_NONE;
}

/* Announces the stages of the bake to the progress display, before its surface points are known. */
static void expect_stages(struct kiln_bake *b, const struct kiln_prepared *p)
{
    struct kiln_stage stages[KILN_STAGES_MAX];
    const bool device = p->choice.asked
                            ? !p->choice.processors
                            : b->job->machine.backend != NULL && strcmp(b->job->machine.backend, "vulkan") == 0;
    const struct kiln_reckoned *expected = &p->choice.reckoned[device ? KILN_RECKON_VULKAN : KILN_RECKON_EMBREE];
    kiln_progress_expect(b->progress, stages, kiln_stages_make(b->job, expected, stages));
}

/* Implements kiln_prepare_care.refuse: checks everything that can be refused before the first ray. */
static int look_ahead(void *context, const struct kiln_prepared *p, struct kiln_error *error)
{
    struct kiln_bake *b = context;
    struct kiln_volume_result volume = {0};
    settle_materials(b, p->scene);
    settle_dark(b, p);
    int status = b->job->volume.samples != 0
                     ? kiln_volume_grid(&volume, p->scene, b->job->volume.spacing, b->job->volume.bounds, error)
                     : KILN_OK;
    if (status == KILN_OK && b->rank == 0 && p->surface != NULL)
        status = check_lightmaps(b, p, error);
    status = kiln_agree(b->communicator, status, error);
    if (status == KILN_OK && p->surface != NULL)
        status = kiln_bake_transport_check(b, p, error);
    if (status == KILN_OK && p->surface != NULL)
        status = compare_with_checkpoint(b, p, error);
    if (status == KILN_OK)
        status = kiln_agree(
            b->communicator,
            kiln_memory_budget_check(p, b->job, volume.size[0] * volume.size[1] * volume.size[2], error), error);
    if (status == KILN_OK) /* a checkpoint that --no-resume discards has been removed by now */
        status = kiln_agree(b->communicator, b->rank == 0 ? check_room(b, p, &volume, error) : KILN_OK, error);
    if (status == KILN_OK && b->rank == 0)
        expect_stages(b, p);
    return status;
}

int kiln_bake_prepare(struct kiln_bake *b, struct kiln_error *error)
{
    const char *before = kiln_identity_instruction_set(kiln_checkpoint_identity(b->checkpoint));
    const bool pin = b->job->machine.instruction_set == NULL && before != NULL;
    struct kiln_job job = *b->job;
    if (pin && kiln_instruction_set_common(b->communicator, before))
        job.machine.instruction_set = (char *)(uintptr_t)before;
    /* a bake is resumed on the checkpoint's backend, if there is one here, since it gives the same bits */
    const char *backend = kiln_identity_backend(kiln_checkpoint_identity(b->checkpoint));
    const bool chosen = job.machine.backend == NULL || strcmp(job.machine.backend, "auto") == 0,
               resumes = backend != NULL && job.checkpoints.resume;
    if (chosen && resumes && !kiln_backend_may_use_device(backend))
        job.machine.backend = (char *)(uintptr_t)backend;
    const struct kiln_prepare_care care = {.control = b->control,
                                           .refuse = look_ahead,
                                           .context = b,
                                           .device_first = chosen && resumes && kiln_backend_may_use_device(backend)};
    int status =
        kiln_prepare(&b->prepared, b->communicator, &job, b->scene_file, &b->phases, b->progress, &care, error);
    if (status == KILN_OK) {
        struct kiln_prepared *p = b->prepared;
        if (b->rank == 0)
            status = kiln_enclosed_lights_find(&p->enclosed, &p->enclosed_count, p->backend, error);
        status = kiln_agree(b->communicator, status, error);
    }
    if (status == KILN_OK && b->rank == 0 && !b->job->quiet)
        say_warnings(b->prepared);
    return status;
}
