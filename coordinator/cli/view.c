/* kiln view: renders a picture of a finished bake. */
#include "coordinator/view/view.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include <jansson.h>

#include "coordinator/run/lock.h"
#include "coordinator/cli/commands.h"
#include "coordinator/bake/devices.h"
#include "coordinator/files/json.h"
#include "coordinator/files/output_name.h"
#include "coordinator/field/field.h"
#include "coordinator/output/exr.h"
#include "coordinator/files/publish.h"
#include "coordinator/field/units.h"
#include "worker/base/text.h"

struct view {
    struct kiln_results *results;
    struct kiln_scene *scene;
    struct kiln_geometry *geometry;
    struct kiln_lights *lights;
    struct kiln_backend *backend;
    struct kiln_picture picture;
    bool texels;                    /* --show texels */
    const struct kiln_field *field; /* the field that --show names; NULL: none */
};

/* Finds the field that --show names. */
static int read_show(struct view *v, const char *name, struct kiln_error *error)
{
    char list[256] = "light, texels";
    size_t rows;
    const struct kiln_field *table = kiln_fields(&rows);
    v->texels = strcmp(name, "texels") == 0;
    if (v->texels || strcmp(name, "light") == 0)
        return KILN_OK;
    v->field = kiln_field_shown(name);
    for (size_t i = 0; i < rows; i++) {
        const size_t used = strlen(list);
        if (table[i].channels != NULL)
            (void)snprintf(list + used, sizeof list - used, ", %s", kiln_field_shown_name(&table[i]));
    }
    return v->field != NULL
               ? KILN_OK
               : kiln_fail(error, KILN_USAGE, "--show %.100s: there is nothing of that name to show; there is: %s",
                           name, list);
}

/* Refuses an exposure for what is shown on a scale of its own. */
static int check_exposure(const struct view *v, const struct kiln_job *job, struct kiln_error *error)
{
    if (v->field == NULL || v->field->meaning == KILN_FIELD_AMOUNT || job->exposure == 0.0)
        return KILN_OK;
    return kiln_fail(error, KILN_USAGE, "--exposure %g: '%s' is shown on a fixed scale; leave --exposure out",
                     job->exposure, kiln_field_shown_name(v->field));
}

static const char *quantity_of(const struct view *v)
{
    return v->texels ? "a checkerboard of texels" : v->field != NULL ? v->field->description : "radiance";
}

static const char *unit_of(const struct view *v)
{
    const struct kiln_units *units = kiln_units_of_bake(v->results);
    return v->field == NULL ? units->radiance : kiln_field_unit(v->field, units);
}

static int open_scene(struct view *v, const struct kiln_job *job, const char *directory, struct kiln_error *error)
{
    int status = kiln_results_open(&v->results, directory, error);
    if (status == KILN_OK)
        status = kiln_results_scene(v->results, &v->scene, error);
    if (status == KILN_OK)
        status = kiln_geometry_create(&v->geometry, v->scene, error);
    if (status == KILN_OK)
        kiln_geometry_make_all_hittable(v->geometry);
    if (status == KILN_OK)
        status = kiln_lights_create(&v->lights, v->scene, v->geometry, error);
    if (status != KILN_OK)
        return status;
    struct kiln_backend_params params = {.scene = v->scene,
                                         .geometry = v->geometry,
                                         .lights = v->lights,
                                         .threads = job->threads,
                                         .instruction_set = job->instruction_set};
    kiln_devices_choose(job, 0, 1, &params);
    return kiln_backend_create(&v->backend, job->backend, &params, error);
}

static int read_point(const char *option, const char *text, double point[3], struct kiln_error *error)
{
    char after;
    if (sscanf(text, "%lf,%lf,%lf%c", &point[0], &point[1], &point[2], &after) != 3)
        return kiln_fail(error, KILN_USAGE, "--%s %s: it must be three numbers separated by commas, such as 1,1.5,3",
                         option, text);
    return KILN_OK;
}

static int render(struct view *v, const struct kiln_job *job, const char *directory, struct kiln_error *error)
{
    double from[3], to[3];
    struct kiln_view_wish wish = {
        .camera = job->camera, .field_of_view = job->field_of_view, .width = job->width, .height = job->height};
    const struct kiln_view_source source = {.directory = directory,
                                            .results = v->results,
                                            .scene = v->scene,
                                            .geometry = v->geometry,
                                            .lights = v->lights,
                                            .backend = v->backend,
                                            .texels = v->texels,
                                            .field = v->field,
                                            .no_normal_maps = !job->normal_maps};
    int status = KILN_OK;
    if (job->from != NULL && (status = read_point("from", job->from, from, error)) == KILN_OK)
        wish.from = from;
    if (status == KILN_OK && job->to != NULL && (status = read_point("to", job->to, to, error)) == KILN_OK)
        wish.to = to;
    return status == KILN_OK ? kiln_picture_make(&source, &wish, 4, &v->picture, error) : status;
}

/* Approximations in the picture, by bits: 1, it shows metals; 2, it shows backs that have no lightmap. */
static const char *const approximations[] = {"", "metals: base colour x irradiance / pi",
                                             "backs: the front's irradiance",
                                             "metals: base colour x irradiance / pi; backs: the front's irradiance"};

static int write_picture(const struct view *v, const struct kiln_job *job, const char *path, struct kiln_error *error)
{
    const char *dot = strrchr(path, '.');
    char viewpoint[KILN_VIEWPOINT_TEXT];
    const char *approximate =
        approximations[(v->picture.approximate.metal > 0.0) + 2 * (v->picture.approximate.front_light > 0.0)];
    if (dot != NULL && strcasecmp(dot, ".png") == 0)
        return kiln_picture_write(NULL, path, &v->picture, job->exposure, error);
    kiln_viewpoint_text(&v->picture.viewpoint, viewpoint);
    const struct kiln_exr_attribute attributes[] = {
        {.name = "kiln:version", .kind = KILN_EXR_STRING, .text = KILN_VERSION},
        {.name = "kiln:quantity", .kind = KILN_EXR_STRING, .text = quantity_of(v)},
        {.name = "kiln:units", .kind = KILN_EXR_STRING, .text = unit_of(v)},
        {.name = "kiln:viewpoint", .kind = KILN_EXR_STRING, .text = viewpoint},
        {.name = "kiln:approximate", .kind = KILN_EXR_STRING, .text = approximate}};
    const size_t count = sizeof attributes / sizeof *attributes - (approximate[0] != '\0' ? 0 : 1);
    return kiln_exr_write(path, v->picture.image, attributes, count, error);
}

static int check_extension(const char *path, struct kiln_error *error)
{
    const char *dot = strrchr(path, '.');
    if (dot != NULL && (strcasecmp(dot, ".png") == 0 || strcasecmp(dot, ".exr") == 0))
        return KILN_OK;
    return kiln_fail(error, KILN_USAGE, "--output %s: a view is written as .png (tone-mapped) or .exr (radiance)",
                     path);
}

static int tell(const struct kiln_job *job, const struct view *v, const char *path, struct kiln_error *error)
{
    const struct kiln_image *image = v->picture.image;
    char text[KILN_PICTURE_TEXT];
    if (job->json) {
        json_t *root = json_pack("{s:s, s:o, s:i, s:i}", "status", "done", "output", kiln_json_string(path), "width",
                                 (int)image->width, "height", (int)image->height);
        json_t *picture = kiln_picture_json(&v->picture, job->exposure);
        (void)json_object_update(root, picture);
        json_decref(picture);
        (void)json_object_set_new(root, "normal_map_share", json_real(v->picture.approximate.mapped));
        (void)json_object_set_new(root, "flat_share", json_real(v->picture.approximate.flat));
        return kiln_json_print(root, error);
    }
    if (job->quiet)
        return KILN_OK;
    kiln_picture_text(&v->picture, job->exposure, text);
    kiln_print(stdout, "%s: %u x %u pixels\n", path, image->width, image->height);
    (void)puts(text); /* several lines; the names in them have no control characters */
    if (v->picture.approximate.flat > 0.0005)
        (void)printf("materials with normal maps, %.1f %% of it, are shown without them: the lightmaps do not say from "
                     "where light comes (kiln bake --directional sh1 does)\n",
                     100.0 * v->picture.approximate.flat);
    return KILN_OK;
}

int kiln_command_view(struct kiln_job *job, struct kiln_error *error)
{
    struct view v = {0};
    char fallback[KILN_PATH_SIZE];
    const char *directory = job->arguments[0], *path = job->output;
    int status = KILN_OK;
    if (path == NULL) {
        status = kiln_path_join(fallback, directory, "view.png", error);
        path = fallback;
    }
    if (status == KILN_OK)
        status = read_show(&v, job->show, error);
    if (status == KILN_OK)
        status = check_exposure(&v, job, error);
    if (status == KILN_OK)
        status = check_extension(path, error);
    const struct kiln_output_name name = {.option = "--output", .path = path, .bakes = {directory}};
    if (status == KILN_OK)
        status = kiln_output_name_check(&name, error);
    if (status == KILN_OK && job->output == NULL)
        status = kiln_lock_refuse(directory, error);
    if (status == KILN_OK)
        status = open_scene(&v, job, directory, error);
    if (status == KILN_OK)
        status = render(&v, job, directory, error);
    if (status == KILN_OK)
        status = write_picture(&v, job, path, error);
    if (status == KILN_OK)
        status = tell(job, &v, path, error);
    kiln_image_destroy(&v.picture.image);
    kiln_backend_destroy(&v.backend);
    kiln_lights_destroy(&v.lights);
    kiln_geometry_destroy(&v.geometry);
    kiln_scene_close(&v.scene);
    kiln_results_close(&v.results);
    return status;
}
