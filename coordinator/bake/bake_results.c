#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "coordinator/bake/bake_private.h"
#include "coordinator/bake/leaf_means.h"
#include "coordinator/bake/reckon/preview_size.h"
#include "coordinator/bake/report/run_report.h"
#include "coordinator/export/export.h"
#include "coordinator/files/publish.h"
#include "coordinator/integrate/reach/sight.h"
#include "coordinator/mpi/agree.h"
#include "coordinator/output/manifest.h"
#include "coordinator/output/read/results.h"
#include "worker/base/color.h"
#include "worker/base/memory.h"
#include "worker/base/text.h"

static int write_points(struct kiln_bake *b, const struct kiln_bake_result *result,
                        const struct kiln_output_params *params, struct kiln_error *error)
{
    (void)b;
    return kiln_write_h5(result, params, error);
}

static int write_volume(struct kiln_bake *b, const struct kiln_bake_result *result,
                        const struct kiln_output_params *params, struct kiln_error *error)
{
    return kiln_write_volume(result, &b->volume, params, error);
}

/* Collective. Writes a file and, if that fails, writes it once more from the beginning. MPI-IO reports an interrupted
 * system call as a failure, or even as a success, which reading back reveals; only a second failure is final. */
static int write_twice(struct kiln_bake *b, const struct kiln_bake_result *result,
                       const struct kiln_output_params *params,
                       int (*write)(struct kiln_bake *, const struct kiln_bake_result *,
                                    const struct kiln_output_params *, struct kiln_error *),
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

/* Restores the earlier reports of the lightmaps that were not written anew. */
static void keep_reports(struct kiln_bake *b, struct kiln_lightmap_report **before)
{
    for (size_t i = 0; *before != NULL && i < b->prepared->surface->map_count; i++)
        if (b->lightmaps[i].valid + b->lightmaps[i].filled == 0)
            b->lightmaps[i] = (*before)[i];
    kiln_free(before);
}

/* Ends packing of kiln.h5 ahead, which has run in the background up to now, and adds it to the timeline. */
static void end_packing(struct kiln_bake *b)
{
    struct kiln_points_ahead_report report;
    kiln_points_ahead_stop(b->ahead);
    kiln_points_ahead_report(b->ahead, &report);
    if (report.chunks > 0)
        kiln_trace_add(b->trace, KILN_TRACE_BESIDE, "points packed ahead", b->ahead_start + report.begin,
                       b->ahead_start + report.end, (int64_t)(report.chunks * KILN_H5_CHUNK_ROWS));
}

/* Collective. Writes the lightmaps. Denoising counts as a phase of its own, since it is no writing of files. */
static int write_lightmaps(struct kiln_bake *b, const struct kiln_bake_result *result,
                           const struct kiln_output_params *params, struct kiln_error *error)
{
    double denoising = 0.0;
    if (params->denoise)
        kiln_phase_add(&b->phases, "denoising", 0.0);
    kiln_phase(&b->phases, "lightmaps");
    kiln_progress_phase(b->progress, "lightmaps", 0);
    const int status = kiln_write_lightmaps(result, params, b->lightmaps, &denoising, error);
    kiln_phase(&b->phases, NULL);
    if (params->denoise)
        kiln_phase_part(&b->phases, "lightmaps", "denoising", denoising);
    return status;
}

static int write_results(struct kiln_bake *b, const char *provenance, struct kiln_error *error)
{
    const struct kiln_node_data *data = b->solution->node_data;
    const struct kiln_sight *sight = b->solution->sight;
    const struct kiln_bake_result result = {.units = kiln_units_of(b->job->scene.units, b->prepared->scene),
                                            .communicator = b->communicator,
                                            .scene = b->prepared->scene,
                                            .geometry = b->prepared->geometry,
                                            .surface = b->prepared->surface,
                                            .fields = kiln_node_data_fields(data),
                                            .data = kiln_rank_data(data, kiln_node_data_own(data)),
                                            .radiosity = b->solution->radiosity,
                                            .sight_units = sight != NULL ? sight->units : 0,
                                            .sight_pair_count = sight != NULL ? sight->pair_count : 0,
                                            .sight_first = sight != NULL ? sight->first : NULL,
                                            .sight_pairs = sight != NULL ? sight->pairs : NULL,
                                            .stop = kiln_control_stop(b->control)};
    struct kiln_output_params params = {.directory = b->job->output,
                                        .half = b->job->lightmaps.half,
                                        .parts = kiln_job_parts(b->job) > 1,
                                        .denoise = kiln_job_denoises(b->job),
                                        .denoise_direct = kiln_job_has_links(b->job),
                                        .stitch = b->job->lightmaps.stitch,
                                        .faults = &b->job->faults,
                                        .least_divided = b->job->faults.divide_from,
                                        .only = b->only,
                                        .ahead = b->ahead,
                                        .backend = b->prepared->backend,
                                        .provenance_json = provenance};
    struct kiln_lightmap_report *before = b->lightmaps;
    int status = kiln_allocate(&b->lightmaps, b->prepared->surface->map_count, sizeof *b->lightmaps,
                               "the lightmaps' report", error);
    status = kiln_agree(b->communicator, status, error);
    if (status == KILN_OK && b->job->lightmaps.store == KILN_STORE_KIND_LIGHTMAP)
        status = write_lightmaps(b, &result, &params, error);
    else if (status == KILN_OK)
        status = kiln_leaf_means(b->lightmaps, &result, kiln_luminance(b->emission.emitted), error);
    if (b->lightmaps != NULL)
        keep_reports(b, &before);
    if (status == KILN_OK && b->job->lightmaps.vertex_light) {
        kiln_phase(&b->phases, "vertices");
        kiln_progress_phase(b->progress, "vertices", 0);
        status = kiln_vertex_light_fit(&b->vertices, &result, error);
        params.vertices = b->rank == 0 ? &b->vertices : NULL;
    }
    if (status == KILN_OK) {
        kiln_phase(&b->phases, "kiln.h5");
        kiln_progress_phase(b->progress, "kiln.h5", 0);
        end_packing(b);
        status = write_twice(b, &result, &params, write_points, error);
        kiln_points_ahead_drop(b->ahead);
    }
    if (status == KILN_OK && b->job->volume.samples != 0) {
        kiln_phase(&b->phases, "volume.hdf");
        kiln_progress_phase(b->progress, "volume.hdf", 0);
        status = write_twice(b, &result, &params, write_volume, error);
    }
    kiln_phase(&b->phases, NULL);
    return status;
}

/* Reads look, exposure and camera of the preview of the bake that is relit. Returns false if that bake has no
 * preview. */
static bool read_picture_before(const struct kiln_bake *b, struct kiln_kept_picture *kept)
{
    struct kiln_results *results = NULL;
    json_t *run = NULL;
    bool found = false;
    if (b->job->relighting.folder == NULL)
        return false;
    if (kiln_results_open(&results, b->job->relighting.folder, NULL) == KILN_OK &&
        kiln_results_has(results, "run.json") && kiln_results_json(results, "run.json", &run, NULL) == KILN_OK)
        found = kiln_picture_keep(json_object_get(run, "preview"), kept);
    json_decref(run);
    kiln_results_close(&results);
    return found;
}

static int draw_picture(struct kiln_bake *b, struct kiln_error *error)
{
    const struct kiln_prepared *p = b->prepared;
    struct kiln_view_source source = {.directory = b->job->output,
                                      .scene = p->scene,
                                      .geometry = p->geometry,
                                      .lights = p->lights,
                                      .backend = p->backend,
                                      .stop = kiln_control_stop(b->control)};
    struct kiln_view_wish wish = {.most_pixels =
                                      kiln_preview_pixels(b->job, p->scene, (double)p->surface->point_count)};
    struct kiln_kept_picture kept;
    const bool keeps = read_picture_before(b, &kept);
    const struct kiln_look own = {.curve = (enum kiln_tone_curve)b->job->view.tone_map,
                                  .stops = b->job->view.exposure,
                                  .no_metering = !b->job->view.auto_exposure},
                           look = keeps ? kept.look : own;
    if (keeps)
        kiln_picture_keep_place(&kept, &wish);
    struct kiln_picture picture = {0};
    /* octree leaves are read back from the folder, as any reader of the bake does; lightmaps were written here, and are
     * read directly */
    int status;
    KILN_TRY(p->surface->bricks != NULL ? kiln_results_open(&source.results, b->job->output, error) : KILN_OK);
    KILN_TRY(kiln_picture_make(&source, &wish, 2, &look, &picture, error));
    if (wish.from != NULL)
        picture.viewpoint.kind = kept.inside ? KILN_VIEW_INSIDE : KILN_VIEW_OUTSIDE;
    KILN_TRY(kiln_picture_write(b->job->output, "preview.png", &picture, &look, error));
    b->preview = kiln_picture_json(&picture, &look);
    if (!b->job->quiet) {
        kiln_viewpoint_text(&picture.viewpoint, b->preview_text);
    }
end:
    kiln_image_destroy(&picture.image);
    kiln_results_close(&source.results);
    return status;
}

static int draw_preview(struct kiln_bake *b, struct kiln_error *error)
{
    if (!b->job->preview)
        return KILN_OK;
    kiln_phase(&b->phases, "preview");
    kiln_progress_phase(b->progress, "preview", 0);
    int status = KILN_OK;
    if (b->rank == 0)
        status = draw_picture(b, error);
    /* rank 0 may have finished before the request to stop reaches it */
    else if (kiln_stop_asked(kiln_control_stop(b->control)))
        status = KILN_STOPPED;
    return kiln_bake_end_phase(b, status, error);
}

/* Removes the scene.glb of an earlier bake, which links to lightmaps that no longer exist. */
static int remove_old_scene(const struct kiln_bake *b, struct kiln_error *error)
{
    char path[KILN_PATH_SIZE];
    struct stat source, there;
    int status;
    KILN_TRY(kiln_path_join(path, b->job->output, "scene.glb", error));
    if (stat(b->job->scene.file, &source) == 0 && stat(path, &there) == 0 && source.st_dev == there.st_dev &&
        source.st_ino == there.st_ino)
        return kiln_fail(error, KILN_BAD_INPUT, "%s is the scene itself; kiln export writes it to another folder",
                         path);
    if (kiln_unlink_below(b->job->output, "scene.glb") != 0 && errno != ENOENT)
        KILN_TRY(kiln_fail_errno(error, KILN_CANNOT_CREATE, "cannot replace %s", path));
end:
    return status;
}

/* Writes scene.glb, or this rank's share of the files of parts. */
static int export_beside(const struct kiln_bake *b, bool in_parts, struct kiln_error *error)
{
    const struct kiln_surface *s = b->prepared->surface;
    const char *unit = kiln_units_of(b->job->scene.units, b->prepared->scene)->irradiance_text;
    /* rank 0 alone has the light at vertices */
    const bool alone = b->job->lightmaps.vertex_light;
    const float(*light)[3] = (const float(*)[3])b->vertices.irradiance;
    uint8_t *backs = NULL;
    int status;
    KILN_TRY(b->rank == 0 ? remove_old_scene(b, error) : KILN_OK);
    KILN_TRY(kiln_allocate(&backs, s->object_count, 1, "the export's links", error));
    for (uint32_t i = kiln_front_maps(s); i < s->map_count; i++)
        if (s->lightmaps[i].published != 0)
            backs[kiln_map_object(s, i)] = 1;
    const struct kiln_export_places places = {.directory = b->job->output,
                                              .scene = b->prepared->scene,
                                              .has_back = backs,
                                              .light = light,
                                              .unit = unit,
                                              .stop = kiln_control_stop(b->control),
                                              .rank = alone ? 0 : (uint32_t)b->rank,
                                              .ranks = alone ? 1 : (uint32_t)b->prepared->ranks};
    if (in_parts && (!alone || b->rank == 0))
        KILN_TRY(kiln_export_places(&places, error));
    else if (!in_parts)
        KILN_TRY(kiln_export_beside(b->job->output, b->job->scene.file, b->prepared->scene, backs, light, unit,
                                    kiln_control_stop(b->control), error));
end:
    kiln_free(&backs);
    return status;
}

/* Writes scene.glb, or the files of parts, in which all ranks share. If the source scene has been removed or changed
 * meanwhile, or does not fit one glTF file, prints a warning; the bake is still valid, and kiln export can write the
 * scene later. */
static int write_scene(struct kiln_bake *b, struct kiln_error *error)
{
    const struct kiln_scene *scene = b->prepared->scene;
    const bool in_parts = scene->object_count > 0 && kiln_scene_place(scene, 0) > 0;
    int status = KILN_OK, told = 0;
    if (!b->job->write_scene)
        return KILN_OK;
    kiln_phase(&b->phases, "scene.glb");
    kiln_progress_phase(b->progress, "scene.glb", 0);
    if (b->rank == 0 || in_parts) {
        struct kiln_error own = {""};
        status = export_beside(b, in_parts, &own);
        told = status == KILN_BAD_INPUT || status == KILN_NO_INPUT || status == KILN_PERMISSION;
        if (told != 0)
            kiln_print(stderr, "kiln: warning: no %s: %s\n", in_parts ? "file of a part" : "scene.glb", own.message);
        else if (status != KILN_OK)
            *error = own;
    }
    kiln_control_meet(b->control);
    (void)MPI_Allreduce(MPI_IN_PLACE, &told, 1, MPI_INT, MPI_MAX, b->communicator);
    b->exported = told == 0;
    return kiln_bake_end_phase(
        b,
        told != 0 && (status == KILN_BAD_INPUT || status == KILN_NO_INPUT || status == KILN_PERMISSION) ? KILN_OK
                                                                                                        : status,
        error);
}

/* Collective. Warns of parts whose files have changed since they were read: the rank that has read one looks. */
static int warn_of_changes(const struct kiln_bake *b, struct kiln_error *error)
{
    const struct kiln_job_scene *scene = &b->job->scene;
    const struct kiln_part_import *imports = b->prepared->import.parts;
    if (imports == NULL)
        return KILN_OK;
    unsigned long long first = kiln_parts_changed(b->job, imports, (uint32_t)b->rank);
    if (MPI_Allreduce(MPI_IN_PLACE, &first, 1, MPI_UNSIGNED_LONG_LONG, MPI_MIN, b->communicator) != MPI_SUCCESS)
        return kiln_fail(error, KILN_RANK_LOST, "MPI failed while the ranks looked for changed parts");
    if (b->rank == 0 && first < scene->part_count)
        kiln_print(
            stderr,
            "kiln: warning: part '%s': %s has changed since it was read, and this bake has it as it was: run the "
            "same command again\n",
            scene->parts[first].name, scene->parts[first].file);
    return KILN_OK;
}

/* Writes run.json, after everything that it names. */
static int write_report(struct kiln_bake *b, struct kiln_error *error)
{
    kiln_phase_rest(&b->phases, b->solution->report.seconds_before);
    const struct kiln_run run = {.job = b->job,
                                 .prepared = b->prepared,
                                 .solution = b->solution,
                                 .volume = &b->volume,
                                 .lightmaps = b->lightmaps,
                                 .vertices = &b->vertices,
                                 .density = &b->density,
                                 .visible = &b->visible,
                                 .phases = &b->phases,
                                 .ahead = b->ahead,
                                 .materials = b->materials,
                                 .probe_rays = b->probe_rays,
                                 .directory = b->job->output};
    int status = kiln_run_report(&b->report, &run, error);
    const bool of_states = b->job->relighting.states != NULL || b->job->relighting.listen; /* the same on all ranks */
    json_t *transport = of_states ? NULL : kiln_bake_transport_json(b);
    if (status == KILN_OK && b->rank == 0 && b->state != NULL)
        (void)json_object_set(b->report, "relight", b->state);
    if (transport != NULL)
        (void)json_object_set_new(b->report, b->transport.replays ? "relight" : "transport", transport);
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
static int write_manifest(struct kiln_bake *b, struct kiln_error *error)
{
    kiln_progress_phase(b->progress, "manifest", 0);
    const struct kiln_optional_results parts = {.volume = b->job->volume.samples != 0,
                                                .preview = b->job->preview,
                                                .scene = b->exported,
                                                .groups = b->job->scene.group_count,
                                                .more = b->transport_files,
                                                .more_count = b->transport_file_count};
    const int status =
        kiln_manifest_write(b->communicator, b->job->output, b->prepared->scene, b->prepared->surface, &parts, error);
    kiln_progress_finish(b->progress);
    return status;
}

int kiln_bake_write(struct kiln_bake *b, struct kiln_error *error)
{
    char *provenance = kiln_provenance(b->job, b->prepared);
    int status =
        kiln_agree(b->communicator,
                   provenance != NULL ? KILN_OK : kiln_fail(error, KILN_SYSTEM, "out of memory: provenance"), error);
    if (status == KILN_OK)
        status = write_results(b, provenance, error);
    free(provenance);
    KILN_TRY(status);
    KILN_TRY(write_scene(b, error));
    KILN_TRY(draw_preview(b, error));
    KILN_TRY(warn_of_changes(b, error));
    KILN_TRY(write_report(b, error));
end:
    return status == KILN_OK ? write_manifest(b, error) : status;
}
