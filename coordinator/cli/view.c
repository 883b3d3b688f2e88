/* kiln view: renders pictures of a finished bake from its lightmaps, or of a scene by path tracing. */
#include "coordinator/view/view.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include <jansson.h>
#include <mpi.h>

#include "coordinator/run/lock.h"
#include "coordinator/run/progress.h"
#include "coordinator/cli/commands.h"
#include "coordinator/cli/view_made.h"
#include "coordinator/cli/view_shots.h"
#include "coordinator/cli/view_team.h"
#include "coordinator/bake/prepare/devices.h"
#include "coordinator/bake/prepare/import_params.h"
#include "coordinator/files/json.h"
#include "coordinator/files/output_name.h"
#include "coordinator/files/temporary.h"
#include "coordinator/field/field.h"
#include "coordinator/mpi/agree.h"
#include "coordinator/output/exr.h"
#include "coordinator/view/places.h"
#include "coordinator/view/show.h"
#include "coordinator/view/view_filter.h"
#include "coordinator/files/publish.h"
#include "coordinator/field/units.h"
#include "coordinator/job/job_private.h"
#include "coordinator/job/options.h"
#include "worker/scene/gloss.h"
#include "worker/base/text.h"
#include "worker/scene/leaves.h"

struct view {
    struct kiln_results *results; /* NULL: the scene is none of a bake */
    struct kiln_temporary temporary;
    struct kiln_scene *scene;
    struct kiln_view_team *team; /* path tracing; NULL: lightmaps */
    struct kiln_geometry *geometry;
    struct kiln_lights *lights;
    struct kiln_backend *backend;
    struct kiln_view_maps *maps;
    struct kiln_shots shots;
    struct kiln_view_filter *filter; /* NULL: none */
    struct kiln_look look;
    struct kiln_exposure exposure;    /* of all frames of a path */
    struct kiln_picture picture;      /* the present one */
    double low[3], high[3];           /* range of colours of a path's first frame, which all have */
    struct kiln_view_approximate sum; /* over pictures */
    json_t *pictures;                 /* what --json says of each */
    struct kiln_show show;
    struct kiln_view_made made;
    const struct kiln_field *field; /* that of the show; NULL: none */
    struct kiln_progress *progress; /* of all pictures; NULL: none is shown */
    size_t drawn;                   /* pictures so far */
};

enum { PICTURE_UNITS = 1000 }; /* of progress */

static int read_show(struct view *v, const char *name, struct kiln_error *error)
{
    const int status = kiln_show_find(&v->show, name, error);
    v->field = v->show.field.name != NULL ? &v->show.field : NULL;
    return status;
}

/* Refuses an exposure for quantities shown on a fixed scale. */
static int check_exposure(const struct view *v, const struct kiln_job *job, struct kiln_error *error)
{
    if (v->field == NULL || v->field->meaning == KILN_FIELD_AMOUNT || job->view.exposure == 0.0)
        return KILN_OK;
    return kiln_fail(error, KILN_USAGE, "--exposure %g: '%s' is shown on a fixed scale; leave --exposure out",
                     job->view.exposure, kiln_field_shown_name(v->field));
}

static const char *quantity_of(const struct view *v, const struct kiln_job *job)
{
    const char *light = job->view.atlas != NULL ? "irradiance" : "radiance";
    return v->show.texels ? "a checkerboard of texels" : v->field != NULL ? v->field->description : light;
}

static const char *unit_of(const struct view *v, const struct kiln_job *job)
{
    const struct kiln_units *units =
        v->results != NULL ? kiln_units_of_bake(v->results) : kiln_units_of(KILN_UNITS_AUTO, v->scene);
    return v->field != NULL          ? kiln_field_unit(v->field, units)
           : job->view.atlas != NULL ? units->irradiance
                                     : units->radiance;
}

static int open_bake(struct view *v, const char *directory, struct kiln_error *error)
{
    int status = kiln_results_open(&v->results, directory, error);
    if (status == KILN_OK)
        status = kiln_results_scene(v->results, &v->scene, error);
    return status;
}

/* Imports job->scene.file to a file of this process. */
static int import_scene(struct view *v, const struct kiln_job *job, struct kiln_error *error)
{
    int status;
    KILN_TRY(kiln_temporary_make(&v->temporary, error));
    struct kiln_import_report report;
    const struct kiln_import_params params = kiln_job_import_params(job, v->temporary.scene_file, NULL);
    KILN_TRY(kiln_import(&params, &report, error));
    KILN_TRY(kiln_scene_open(&v->scene, v->temporary.scene_file, error));
end:
    return status;
}

static int open_scene(struct view *v, const struct kiln_job *job, struct kiln_error *error)
{
    return job->scene.file != NULL ? import_scene(v, job, error) : open_bake(v, job->arguments[0], error);
}

/* Builds the leaves of a bake with an octree; run.json has their size. */
static int lay_leaves(struct view *v, struct kiln_error *error)
{
    json_t *run = NULL;
    int status = KILN_OK;
    if (v->results == NULL || !kiln_results_has(v->results, "run.json"))
        return KILN_OK;
    status = kiln_results_json(v->results, "run.json", &run, error);
    const json_t *store = json_object_get(run, "store"), *kind = json_object_get(store, "kind");
    if (status == KILN_OK && json_is_string(kind) && strcmp(json_string_value(kind), "octree") == 0)
        status = kiln_leaves_lay(v->geometry, json_number_value(json_object_get(store, "leaf_size")), error);
    json_decref(run);
    return status;
}

/* Makes the data that --show needs besides lightmaps and kiln.h5. */
static int make_shown(struct view *v, const struct kiln_job *job, struct kiln_error *error)
{
    return kiln_view_made_create(&v->made, job, &v->show, v->results, v->scene, v->geometry, error);
}

static int open_backend(struct view *v, const struct kiln_job *job, struct kiln_error *error)
{
    int status = kiln_geometry_create(&v->geometry, v->scene, error);
    if (status == KILN_OK)
        status = lay_leaves(v, error);
    if (status == KILN_OK)
        status = make_shown(v, job, error);
    if (status == KILN_OK)
        kiln_geometry_make_all_hittable(v->geometry);
    if (status == KILN_OK)
        status = kiln_lights_create(&v->lights, v->scene, v->geometry, error);
    if (status != KILN_OK)
        return status;
    struct kiln_backend_params params = {.scene = v->scene,
                                         .geometry = v->geometry,
                                         .lights = v->lights,
                                         .threads = job->machine.threads,
                                         .instruction_set = job->machine.instruction_set};
    kiln_devices_choose(job, 0, 1, &params);
    return kiln_backend_create(&v->backend, job->machine.backend, &params, error);
}

/* Shows that the fraction `share` of the present picture is drawn: `tell` of the source. */
static void show_share(void *context, double share)
{
    const struct view *v = context;
    kiln_progress_advance(v->progress, (uint64_t)((double)PICTURE_UNITS * ((double)v->drawn + share)));
}

static bool was_given(const struct kiln_job *job, const char *name)
{
    const struct kiln_job_owned *owned = job->strings;
    return owned->given[kiln_option_find_for(name, KILN_FOR_VIEW) - kiln_options];
}

static struct kiln_view_source source_of(struct view *v, const struct kiln_job *job, const char *directory)
{
    struct kiln_view_source source = {.directory = directory,
                                      .results = v->results,
                                      .scene = v->scene,
                                      .geometry = v->geometry,
                                      .lights = v->lights,
                                      .backend = v->backend,
                                      .texels = v->show.texels,
                                      .field = v->field,
                                      .nearest = was_given(job, "filter") ? job->view.filter == KILN_VIEW_FILTER_NEAREST
                                                                          : v->show.squares,
                                      .no_normal_maps = !job->view.normal_maps,
                                      .maps = v->maps,
                                      .tell = show_share,
                                      .tell_context = v};
    kiln_view_made_lend(&v->made, &source);
    if (v->team != NULL)
        kiln_view_team_lend(v->team, &source);
    return source;
}

/* Whether the pictures have the colours of an exposure. */
static bool is_exposed(const struct view *v, const char *output)
{
    const char *dot = strrchr(output, '.');
    return strcasecmp(dot, ".png") == 0 && (v->field == NULL || v->field->meaning == KILN_FIELD_AMOUNT);
}

/* Opens the data that all pictures share: lightmaps, and the exposure of a path's frames. */
static int prepare(struct view *v, const struct kiln_job *job, const char *directory, struct kiln_error *error)
{
    struct kiln_view_source source = source_of(v, job, directory);
    v->look = (struct kiln_look){.curve = (enum kiln_tone_curve)job->view.tone_map,
                                 .stops = job->view.exposure,
                                 .no_metering = !job->view.auto_exposure};
    v->pictures = json_array();
    int status = kiln_view_maps_create(&v->maps, &source, 0, error);
    source.maps = v->maps;
    if (status == KILN_OK)
        kiln_view_made_give_rows(&v->made, v->maps);
    if (status == KILN_OK && v->shots.kind == KILN_SHOTS_PATH && !v->look.no_metering && is_exposed(v, v->shots.output))
        status = kiln_view_meter(&source, v->shots.wishes, v->shots.count, &v->exposure, error);
    return status;
}

/* Labels the picture with the key and note of what was made for it. */
static void describe_made(struct view *v)
{
    v->picture.key = v->made.key.pairs > 0 ? &v->made.key : NULL;
    v->picture.note = v->made.note[0] != '\0' ? v->made.note : NULL;
}

/* Gives all frames of a path the range of the first one. */
static void share_range(struct view *v, size_t index)
{
    for (int c = 0; c < 3; c++) {
        if (index == 0) {
            v->low[c] = v->picture.low[c];
            v->high[c] = v->picture.high[c];
        }
        v->picture.low[c] = v->low[c];
        v->picture.high[c] = v->high[c];
    }
}

static int render(struct view *v, const struct kiln_job *job, const char *directory, size_t index,
                  struct kiln_error *error)
{
    const struct kiln_view_source source = source_of(v, job, directory);
    struct kiln_view_wish wish = v->shots.wishes[index];
    wish.surfaces = job->view.aov;
    wish.filter = v->filter;
    kiln_image_destroy(&v->picture.image);
    const int status = kiln_picture_make(&source, &wish, 4, &v->look, &v->picture, error);
    v->picture.unit = unit_of(v, job);
    describe_made(v);
    if (v->shots.kind == KILN_SHOTS_PATH)
        share_range(v, index);
    if (status == KILN_OK && v->exposure.scale > 0.0) {
        v->picture.exposure = v->exposure;
        v->picture.metering = KILN_METERED_PATH;
    }
    const double part = 1.0 / (double)v->shots.count;
    v->sum.metal += part * v->picture.approximate.metal;
    v->sum.front_light += part * v->picture.approximate.front_light;
    v->sum.flat += part * v->picture.approximate.flat;
    return status;
}

/* Approximations in the picture, by bits: 1, it shows metals; 2, it shows backs that have no lightmap. */
static const char *const approximations[] = {"", "metals: base colour x irradiance / pi",
                                             "backs: the front's irradiance",
                                             "metals: base colour x irradiance / pi; backs: the front's irradiance"};

/* Without a value: 0 in EXR files. */
static void fill_missing(const struct kiln_image *image)
{
    for (size_t c = 0; c < image->channel_count; c++)
        for (size_t i = 0; i < (size_t)image->width * image->height; i++)
            if (isnan(image->channels[c].values[i]))
                image->channels[c].values[i] = 0.0f;
}

static int write_picture(const struct view *v, const struct kiln_job *job, const char *path, struct kiln_error *error)
{
    const char *dot = strrchr(path, '.');
    char viewpoint[KILN_VIEWPOINT_TEXT];
    const char *approximate =
        approximations[(v->picture.approximate.metal > 0.0) + 2 * (v->picture.approximate.front_light > 0.0)];
    if (dot != NULL && strcasecmp(dot, ".png") == 0)
        return kiln_picture_write(NULL, path, &v->picture, &v->look, error);
    if (v->field != NULL)
        fill_missing(v->picture.image);
    kiln_viewpoint_text(&v->picture.viewpoint, viewpoint);
    const struct kiln_exr_attribute attributes[] = {
        {.name = "kiln:version", .kind = KILN_EXR_STRING, .text = KILN_VERSION},
        {.name = "kiln:quantity", .kind = KILN_EXR_STRING, .text = quantity_of(v, job)},
        {.name = "kiln:units", .kind = KILN_EXR_STRING, .text = v->picture.unit},
        {.name = "kiln:viewpoint", .kind = KILN_EXR_STRING, .text = viewpoint},
        {.name = "kiln:approximate", .kind = KILN_EXR_STRING, .text = approximate}};
    const size_t count = sizeof attributes / sizeof *attributes - (approximate[0] != '\0' ? 0 : 1);
    return kiln_exr_write(path, v->picture.image, attributes, count, error);
}

static int check_extension(const struct kiln_job *job, const char *path, struct kiln_error *error)
{
    const char *dot = strrchr(path, '.');
    if (job->view.aov && dot != NULL && strcasecmp(dot, ".png") == 0)
        return kiln_fail(error, KILN_USAGE, "--output %s: --aov adds layers, which PNG has not; write .exr", path);
    if (dot != NULL && (strcasecmp(dot, ".png") == 0 || strcasecmp(dot, ".exr") == 0))
        return KILN_OK;
    return kiln_fail(error, KILN_USAGE, "--output %s: a view is written as .png (tone-mapped) or .exr (radiance)",
                     path);
}

static json_t *picture_json(const struct view *v, const char *path)
{
    const struct kiln_image *image = v->picture.image;
    json_t *root = json_pack("{s:o, s:i, s:i}", "output", kiln_json_string(path), "width", (int)image->width, "height",
                             (int)image->height);
    json_t *picture = kiln_picture_json(&v->picture, &v->look);
    (void)json_object_update(root, picture);
    json_decref(picture);
    (void)json_object_set_new(root, "normal_map_share", json_real(v->picture.approximate.mapped));
    (void)json_object_set_new(root, "flat_share", json_real(v->picture.approximate.flat));
    if (v->made.voxels != NULL) {
        const struct kiln_voxel_grid grid = kiln_voxels_grid(v->made.voxels);
        (void)json_object_set_new(root, "voxels",
                                  json_pack("{s:[i,i,i], s:f, s:I}", "cells", grid.n[0], grid.n[1], grid.n[2], "side",
                                            grid.side, "filled", (json_int_t)grid.filled));
    }
    if (v->show.kind == KILN_SHOW_SEEN)
        (void)json_object_set_new(
            root, "seen",
            json_pack("{s:o, s:I, s:I, s:I, s:I}", "texel", kiln_json_string(v->made.seen.texel), "facing",
                      (json_int_t)v->made.seen.facing, "rays", (json_int_t)v->made.seen.by_rays, "voxels",
                      (json_int_t)v->made.seen.by_voxels, "both", (json_int_t)v->made.seen.by_both));
    else if (v->made.note[0] != '\0')
        (void)json_object_set_new(root, "links",
                                  json_pack("{s:i, s:i, s:f}", "nodes", (int)v->made.nodes, "texels",
                                            (int)v->made.single, "view", v->made.all));
    if (v->team != NULL) {
        const struct kiln_view_work work = kiln_view_team_work(v->team);
        (void)json_object_set_new(root, "samples", json_integer((json_int_t)work.samples));
        (void)json_object_set_new(root, "rays", json_integer((json_int_t)work.rays));
        (void)json_object_set_new(root, "seconds", json_real(work.seconds));
        if (work.radius > 0.0)
            (void)json_object_set_new(root, "merge_radius", json_real(work.radius));
    }
    if (v->filter != NULL) {
        double seconds, of_surfaces;
        kiln_view_filter_seconds(v->filter, &seconds, &of_surfaces);
        (void)json_object_set_new(root, "filter_seconds", json_real(seconds));
        (void)json_object_set_new(root, "surfaces_seconds", json_real(of_surfaces));
    }
    return root;
}

/* Says how much was traced so far. */
static void print_work(const struct view *v, const struct kiln_job *job)
{
    const struct kiln_view_work work = kiln_view_team_work(v->team);
    char bounces[32] = "all";
    if (job->light.bounces >= 0)
        (void)snprintf(bounces, sizeof bounces, "%lld", (long long)job->light.bounces);
    (void)printf("path-traced, %u paths a pixel, %s indirect bounces; %.3g million rays in %.3g s\n", work.samples,
                 bounces, 1e-6 * (double)work.rays, work.seconds);
    if (work.radius > 0.0)
        (void)printf("light is merged within %.3g m at first, and within less in each sample\n", work.radius);
}

/* Prints the notes on a picture, or on all frames of a path. */
static void print_notes(const struct kiln_picture *picture, const struct kiln_look *look)
{
    char notes[KILN_PICTURE_TEXT];
    kiln_picture_notes(picture, look, notes);
    (void)puts(notes); /* may have several lines, but no control characters */
    if (picture->approximate.flat > 0.0005)
        (void)printf("materials with normal maps, %.1f %% of it, are shown without them: the lightmaps do not say from "
                     "where light comes (kiln bake --directional sh1 does)\n",
                     100.0 * picture->approximate.flat);
}

static void tell_picture(const struct kiln_job *job, struct view *v, const char *path)
{
    const struct kiln_image *image = v->picture.image;
    char viewpoint[KILN_VIEWPOINT_TEXT];
    if (job->json)
        (void)json_array_append_new(v->pictures, picture_json(v, path));
    if (job->json || job->quiet)
        return;
    kiln_viewpoint_text(&v->picture.viewpoint, viewpoint);
    kiln_print(stdout, "%s: %u x %u pixels%s%s\n", path, image->width, image->height,
               v->shots.kind == KILN_SHOTS_PATH ? ", " : "", v->shots.kind == KILN_SHOTS_PATH ? viewpoint : "");
    if (v->shots.kind != KILN_SHOTS_PATH) {
        (void)puts(viewpoint);
        print_notes(&v->picture, &v->look);
        if (v->team != NULL)
            print_work(v, job);
    }
}

/* Prints the properties that all pictures share. */
static int tell_all(const struct kiln_job *job, struct view *v, struct kiln_error *error)
{
    if (job->json && v->team != NULL && kiln_view_team_stopped(v->team, NULL) != KILN_OK)
        return KILN_OK; /* the object that says so follows */
    if (job->json && v->shots.kind == KILN_SHOTS_ONE) {
        json_t *root = json_pack("{s:s}", "status", "done");
        (void)json_object_update(root, json_array_get(v->pictures, 0));
        return kiln_json_print(root, error);
    }
    if (job->json)
        return kiln_json_print(json_pack("{s:s, s:O}", "status", "done", "pictures", v->pictures), error);
    if (!job->quiet && v->shots.kind == KILN_SHOTS_PATH) {
        v->picture.approximate = v->sum;
        print_notes(&v->picture, &v->look);
        if (v->team != NULL)
            print_work(v, job);
    }
    return KILN_OK;
}

static int draw_all(struct view *v, const struct kiln_job *job, const char *directory, struct kiln_error *error)
{
    char path[KILN_PATH_SIZE];
    int status;
    const struct kiln_stage stage = {v->shots.count > 1 ? "pictures" : "picture", KILN_STAGE_UNKNOWN, true};
    kiln_progress_expect(v->progress, &stage, 1);
    kiln_progress_phase(v->progress, stage.name, PICTURE_UNITS * v->shots.count);
    KILN_TRY(prepare(v, job, directory, error));
    for (size_t i = 0; i < v->shots.count; i++) {
        KILN_TRY(render(v, job, directory, i, error));
        v->drawn = i + 1;
        show_share(v, 0.0);
        kiln_progress_make_room(v->progress);
        KILN_TRY(kiln_shots_path(&v->shots, v->scene, i, path, error));
        KILN_TRY(write_picture(v, job, path, error));
        tell_picture(job, v, path);
    }
    kiln_progress_finish(v->progress);
    KILN_TRY(tell_all(job, v, error));
end:
    return status;
}

/* Checks, before any work is done, that all pictures can be written. */
static int check_names(const struct view *v, const char *directory, struct kiln_error *error)
{
    char path[KILN_PATH_SIZE];
    int status = KILN_OK;
    for (size_t i = 0; status == KILN_OK && i < v->shots.count; i++) {
        const struct kiln_output_name name = {.option = "--output", .path = path, .bakes = {directory}};
        status = kiln_shots_path(&v->shots, v->scene, i, path, error);
        if (status == KILN_OK)
            status = kiln_output_name_check(&name, error);
    }
    return status;
}

/* ---- options of one method ---- */

static const char *view_method(const struct kiln_job *job)
{
    return kiln_options[kiln_option_find_for("method", KILN_FOR_VIEW) - kiln_options].choices[job->view.method];
}

static int check_method(const struct view *v, const struct kiln_job *job, struct kiln_error *error)
{
    static const char *const of_paths[] = {"bounces",     "samples-pixel", "seed",     "lens-radius", "focus-distance",
                                           "path-length", "accumulate",    "max-time", "denoise",     "sequence"},
                             *const of_sums[] = {"resume", "checkpoint-every"},
                             *const of_scenes[] = {"environment", "environment-scale", "environment-rotation"},
                             *const of_files[] = {"up", "unit", "strict"};
    const char *const method = view_method(job);
    for (size_t i = 0; i < sizeof of_paths / sizeof *of_paths && !kiln_view_is_traced(job->view.method); i++)
        if (was_given(job, of_paths[i]))
            return kiln_fail(error, KILN_USAGE,
                             "--%s: the light in lightmaps is as it was baked; only --method path and its like compute "
                             "light",
                             of_paths[i]);
    for (size_t i = 0; i < sizeof of_sums / sizeof *of_sums && job->view.accumulate == NULL; i++)
        if (was_given(job, of_sums[i]))
            return kiln_fail(error, KILN_USAGE, "--%s: nothing is kept of a view without --accumulate DIR", of_sums[i]);
    for (size_t i = 0; i < sizeof of_scenes / sizeof *of_scenes && job->scene.file == NULL; i++)
        if (was_given(job, of_scenes[i]))
            return kiln_fail(
                error, KILN_USAGE,
                "--%s: a bake's surroundings are as it was baked; kiln view SCENE --method path takes others",
                of_scenes[i]);
    for (size_t i = 0; i < sizeof of_files / sizeof *of_files && job->scene.file == NULL; i++)
        if (was_given(job, of_files[i]))
            return kiln_fail(error, KILN_USAGE,
                             "--%s: a bake's scene has been read; kiln view SCENE --method path reads one",
                             of_files[i]);
    if (kiln_view_is_traced(job->view.method) && (v->show.texels || v->field != NULL))
        return kiln_fail(error, KILN_USAGE,
                         "--method %s --show %.100s: path tracing shows light; leave one of the two out", method,
                         job->view.show);
    if (job->light.merge_radius > 0.0 && job->view.method < KILN_VIEW_METHOD_vcm)
        return kiln_fail(error, KILN_USAGE,
                         "--method %s --merge-radius %g: nothing is merged; leave --merge-radius out", method,
                         job->light.merge_radius);
    return KILN_OK;
}

/* Warns of the light in the scene that --method path cannot find. */
static void warn_of_missed(struct view *v, const struct kiln_job *job)
{
    const struct kiln_view_source source = source_of(v, job, NULL);
    if (job->view.method == KILN_VIEW_METHOD_path && kiln_path_view_misses(v->scene, source.lights))
        (void)fprintf(stderr,
                      "kiln: note: --method path misses the light of points, spots and suns that comes by way of "
                      "mirrors and smooth glass; --method vcm or bdpt finds it\n");
}

/* Refuses several pictures if sums are accumulated or time is limited, which is possible for one picture only. */
static int check_one(const struct view *v, const struct kiln_job *job, struct kiln_error *error)
{
    const bool one = v->shots.kind != KILN_SHOTS_PATH && v->shots.count == 1;
    if (one || (job->view.accumulate == NULL && !(job->checkpoints.max_time > 0.0)))
        return KILN_OK;
    return kiln_fail(error, KILN_USAGE, "--%s is for one picture: leave --path out, or name one --camera",
                     job->view.accumulate != NULL ? "accumulate" : "max-time");
}

/* Refuses options that contradict --sequence or --denoise. */
static int check_filter(const struct kiln_job *job, struct kiln_error *error)
{
    if (job->view.sequence && job->view.path == NULL)
        return kiln_fail(error, KILN_USAGE,
                         "--sequence: frames follow each other along a path; --path FILE.csv names one");
    if (job->view.denoise != KILN_VIEW_DENOISE_NONE &&
        (job->view.accumulate != NULL || job->checkpoints.max_time > 0.0))
        return kiln_fail(error, KILN_USAGE,
                         "--denoise goes by two halves of the paths, and --%s is for paths in one piece; leave one of "
                         "the two out",
                         job->view.accumulate != NULL ? "accumulate" : "max-time");
    if ((job->view.sequence || job->view.denoise != KILN_VIEW_DENOISE_NONE) && job->view.lens_radius > 0.0)
        return kiln_fail(error, KILN_USAGE,
                         "--lens-radius %g: --%s goes by what a pinhole sees; leave one of the two out",
                         job->view.lens_radius, job->view.sequence ? "sequence" : "denoise");
    return KILN_OK;
}

/* Refuses a view of a scene without bake, camera or viewpoint. The automatic viewpoint needs the light of lightmaps. */
static int check_aim(const struct view *v, const struct kiln_job *job, struct kiln_error *error)
{
    if (v->results != NULL || v->scene->camera_count > 0 || job->view.from != NULL || job->view.path != NULL)
        return KILN_OK;
    return kiln_fail(error, KILN_USAGE,
                     "the scene has no camera: --from X,Y,Z --to X,Y,Z says where to look from (of a bake, kiln view "
                     "finds a place by itself)");
}

/* ---- the command ---- */

/* Refuses options that contradict --atlas or --filter. */
static int check_atlas(const struct view *v, const struct kiln_job *job, struct kiln_error *error)
{
    static const char *const of_cameras[] = {"camera", "from", "to",     "field-of-view",
                                             "height", "path", "frames", "aov"};
    if (kiln_view_is_traced(job->view.method) && (job->view.atlas != NULL || was_given(job, "filter")))
        return kiln_fail(error, KILN_USAGE, "--method %s --%s: path tracing has no texels; leave one of the two out",
                         view_method(job), job->view.atlas != NULL ? "atlas" : "filter");
    for (size_t i = 0; i < sizeof of_cameras / sizeof *of_cameras && job->view.atlas != NULL; i++)
        if (was_given(job, of_cameras[i]))
            return kiln_fail(error, KILN_USAGE,
                             "--atlas %.100s --%s: a lightmap is seen by no camera; leave one of the two out",
                             job->view.atlas, of_cameras[i]);
    if (v->show.texels && was_given(job, "filter"))
        return kiln_fail(error, KILN_USAGE, "--filter: texels are shown as they are; leave --filter out");
    return KILN_OK;
}

/* Checks options as far as possible before the scene is open. */
static int check_options(struct view *v, const struct kiln_job *job, const char *path, struct kiln_error *error)
{
    const bool bake = job->scene.file == NULL;
    const struct kiln_output_name name = {
        .option = "--output", .path = path, .inputs = {job->scene.file}, .bakes = {bake ? job->arguments[0] : NULL}};
    int status;
    KILN_TRY(read_show(v, job->view.show, error));
    KILN_TRY(check_method(v, job, error));
    KILN_TRY(check_filter(job, error));
    KILN_TRY(check_atlas(v, job, error));
    KILN_TRY(check_exposure(v, job, error));
    KILN_TRY(kiln_view_made_check(job, &v->show, was_given(job, "voxels"), was_given(job, "filter"), error));
    KILN_TRY(check_extension(job, path, error));
    KILN_TRY(kiln_output_name_check(&name, error));
    if (job->output == NULL && bake)
        KILN_TRY(kiln_lock_refuse(job->arguments[0], error));
end:
    return status;
}

/* Chooses the picture's path: --output, or view.png in the bake's folder, or a name made from the scene's. */
static int choose_output(struct kiln_job *job, char path[KILN_PATH_SIZE], struct kiln_error *error)
{
    if (job->output == NULL && job->scene.file == NULL)
        return kiln_path_join(path, job->arguments[0], "view.png", error);
    const char *given = job->output;
    int status = given == NULL ? kiln_job_default_output(job, job->scene.file, "-view.png", error) : KILN_OK;
    if (status == KILN_OK && snprintf(path, KILN_PATH_SIZE, "%s", job->output) >= KILN_PATH_SIZE)
        status = kiln_fail(error, KILN_USAGE, "--output %.200s: the path is too long", job->output);
    return status;
}

static void close_view(struct view *v)
{
    kiln_progress_destroy(&v->progress);
    json_decref(v->pictures);
    kiln_shots_destroy(&v->shots);
    kiln_view_filter_destroy(&v->filter);
    kiln_view_maps_destroy(&v->maps);
    kiln_view_made_destroy(&v->made);
    kiln_image_destroy(&v->picture.image);
    kiln_view_team_destroy(&v->team);
    kiln_backend_destroy(&v->backend);
    kiln_lights_destroy(&v->lights);
    kiln_geometry_destroy(&v->geometry);
    kiln_scene_close(&v->scene);
    kiln_results_close(&v->results);
    kiln_temporary_remove(&v->temporary);
}

/* Sets the treatment of materials: --materials, or else that of the bake. */
static int take_materials(const struct view *v, const struct kiln_job *job, struct kiln_error *error)
{
    const char *const *names = kiln_option_find_for("materials", KILN_FOR_VIEW)->choices;
    enum kiln_gloss_mode mode = (enum kiln_gloss_mode)job->light.materials;
    json_t *run = NULL;
    int status = KILN_OK;
    if (!was_given(job, "materials") && kiln_results_has(v->results, "run.json"))
        status = kiln_results_json(v->results, "run.json", &run, error);
    const char *baked = json_string_value(json_object_get(json_object_get(run, "materials"), "mode"));
    for (int i = 0; baked != NULL && names[i] != NULL; i++)
        if (strcmp(baked, names[i]) == 0)
            mode = (enum kiln_gloss_mode)i;
    json_decref(run);
    return status == KILN_OK ? kiln_scene_take_gloss(v->scene, mode, error) : status;
}

/* Draws the lightmap of one object as a flat picture. */
static int draw_atlas(struct view *v, const struct kiln_job *job, const char *path, struct kiln_error *error)
{
    int status = kiln_geometry_create(&v->geometry, v->scene, error);
    if (status == KILN_OK)
        status = lay_leaves(v, error);
    if (status == KILN_OK)
        status = make_shown(v, job, error);
    if (status == KILN_OK)
        status = prepare(v, job, job->arguments[0], error);
    const struct kiln_view_source source = source_of(v, job, job->arguments[0]);
    if (status == KILN_OK)
        status = kiln_atlas_make(&source, job->view.atlas, job->view.width, &v->look, &v->picture, error);
    v->picture.unit = unit_of(v, job);
    describe_made(v);
    if (status == KILN_OK)
        status = write_picture(v, job, path, error);
    if (status == KILN_OK)
        tell_picture(job, v, path);
    return status == KILN_OK ? tell_all(job, v, error) : status;
}

/* Writes the list of viewpoints instead of a picture. */
static int write_places(struct view *v, const struct kiln_job *job, const char *path, struct kiln_error *error)
{
    const struct kiln_output_name name = {.option = "--output", .path = path, .bakes = {job->arguments[0]}};
    const char *dot = strrchr(path, '.');
    if (job->output == NULL || dot == NULL || strcasecmp(dot, ".csv") != 0)
        return kiln_fail(error, KILN_USAGE, "--places writes a path of cameras: give -o FILE.csv");
    int status;
    KILN_TRY(kiln_output_name_check(&name, error));
    KILN_TRY(open_scene(v, job, error));
    KILN_TRY(kiln_places_write(v->scene, job->view.places, path, error));
    if (job->json)
        KILN_TRY(kiln_json_print(json_pack("{s:s, s:i, s:o}", "status", "done", "places", (int)job->view.places,
                                           "output", kiln_json_string(path)),
                                 error));
end:
    return status;
}

/* Draws views of lightmaps, in one process. */
static int view_lightmaps(struct view *v, const struct kiln_job *job, const char *path, struct kiln_error *error)
{
    int status;
    KILN_TRY(check_options(v, job, path, error));
    KILN_TRY(open_scene(v, job, error));
    KILN_TRY(take_materials(v, job, error));
    if (job->view.atlas != NULL)
        return draw_atlas(v, job, path, error);
    KILN_TRY(kiln_shots_make(job, v->scene, path, &v->shots, error));
    KILN_TRY(check_names(v, job->arguments[0], error));
    KILN_TRY(open_backend(v, job, error));
    if (v->geometry->leaves != NULL && was_given(job, "filter"))
        KILN_TRY(
            kiln_fail(error, KILN_USAGE, "--filter: a bake with --store octree has no texels; leave --filter out"));
    KILN_TRY(draw_all(v, job, job->arguments[0], error));
end:
    return status;
}

/* Collective. Draws path-traced views: rank 0 draws, and the others compute their parts of the pictures. */
static int view_paths(struct view *v, const struct kiln_job *job, const char *path, struct kiln_error *error)
{
    int rank;
    (void)MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    int status = rank == 0 ? check_options(v, job, path, error) : KILN_OK;
    status = kiln_agree(MPI_COMM_WORLD, status, error);
    if (status != KILN_OK)
        return status;
    status = open_scene(v, job, error);
    if (status == KILN_OK)
        status = kiln_path_view_check(v->scene, error);
    if (status == KILN_OK)
        status = kiln_scene_take_gloss(v->scene, (enum kiln_gloss_mode)job->light.materials, error);
    if (status == KILN_OK)
        status = check_aim(v, job, error);
    status = kiln_view_team_create(&v->team, job, v->scene, status, error);
    if (status == KILN_OK && rank != 0)
        kiln_view_team_serve(v->team);
    if (status != KILN_OK || rank != 0)
        return status;
    KILN_TRY(kiln_shots_make(job, v->scene, path, &v->shots, error));
    KILN_TRY(check_one(v, job, error));
    KILN_TRY(check_names(v, job->scene.file == NULL ? job->arguments[0] : NULL, error));
    if (job->view.sequence || job->view.denoise != KILN_VIEW_DENOISE_NONE)
        KILN_TRY(kiln_view_filter_create(&v->filter, job->view.sequence, job->view.denoise != KILN_VIEW_DENOISE_NONE,
                                         error));
    warn_of_missed(v, job);
    KILN_TRY(draw_all(v, job, job->arguments[0], error));
    KILN_TRY(kiln_view_team_stopped(v->team, error));
end:
    kiln_view_team_end(v->team);
    return status;
}

int kiln_command_view(struct kiln_job *job, struct kiln_error *error)
{
    struct view v = {.temporary = {.descriptor = -1}};
    char path[KILN_PATH_SIZE];
    int status = choose_output(job, path, error), with_mpi, rank = 0;
    (void)MPI_Initialized(&with_mpi);
    if (with_mpi != 0)
        (void)MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    v.progress = kiln_progress_create(job->quiet || job->json, rank);
    if (status == KILN_OK && job->view.places > 0 && rank == 0)
        status = write_places(&v, job, path, error);
    else if (status == KILN_OK && job->view.places == 0 && kiln_view_is_traced(job->view.method))
        status = view_paths(&v, job, path, error);
    else if (status == KILN_OK && job->view.places == 0 && rank == 0) /* which draws alone */
        status = view_lightmaps(&v, job, path, error);
    close_view(&v);
    return status;
}
