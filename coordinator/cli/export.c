/* kiln export DIR: writes the scene with its lightmaps, or its light at vertices, for engines. */
#include "coordinator/export/export.h"

#include <errno.h>
#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "coordinator/run/output_folder.h"
#include "coordinator/cli/commands.h"
#include "coordinator/files/json.h"
#include "coordinator/files/output_name.h"
#include "coordinator/export/pages.h"
#include "coordinator/files/publish.h"
#include "coordinator/field/units.h"
#include "coordinator/output/read/rows.h"
#include "worker/base/memory.h"
#include "worker/base/text.h"

struct export
{
    const struct kiln_job *job;
    const char *directory, *output;
    char fallback[KILN_PATH_SIZE], folder[KILN_PATH_SIZE], scene_file[KILN_PATH_SIZE], source[KILN_PATH_SIZE];
    struct kiln_output_folder *place;
    struct kiln_results *results;
    struct kiln_scene *scene;
    uint8_t *backs;           /* for each object, whether its back has a lightmap; NULL: none has */
    struct kiln_pages *pages; /* NULL: the bake has no lightmaps */
    struct kiln_link *none;   /* then: one for each object */
    float(*light)[3];         /* irradiance of the vertices of all objects; NULL: the bake has none */
    uint64_t vertices;        /* how many */
    json_t *run;              /* content of run.json */
};

static bool has_lightmaps(const struct export *e)
{
    const json_t *store = json_object_get(json_object_get(e->run, "store"), "kind");
    return !json_is_string(store) || strcmp(json_string_value(store), "lightmap") == 0;
}

/* Refuses a bake without anything to export, and options for lightmaps if it has none. */
static int check_store(const struct export *e, struct kiln_error *error)
{
    if (has_lightmaps(e))
        return KILN_OK;
    if (json_object_get(e->run, "vertices") == NULL)
        return kiln_fail(error, KILN_BAD_INPUT,
                         "%.512s has neither lightmaps nor light at vertices to export: its light is in the leaves of "
                         "an octree, /points and /irradiance of kiln.h5; bake with --vertex-light, or with --store "
                         "lightmap",
                         e->directory);
    const char *option = e->job->exported.atlas != 0                ? "atlas"
                         : e->job->exported.range > 0.0             ? "range"
                         : e->job->exported.format != KILN_PAGE_EXR ? "format"
                                                                    : NULL;
    return option == NULL
               ? KILN_OK
               : kiln_fail(error, KILN_USAGE, "--%s is for lightmaps, and %.512s has none: its light is at vertices",
                           option, e->directory);
}

/* Reads run.json, which names the scene that was baked. */
static int read_run(struct export *e, struct kiln_error *error)
{
    int status = kiln_results_open(&e->results, e->directory, error);
    if (status == KILN_OK)
        status = kiln_results_json(e->results, "run.json", &e->run, error);
    if (status == KILN_NO_INPUT)
        return kiln_fail(error, KILN_NO_INPUT, "%.512s holds no finished bake: there is no run.json in it; bake first",
                         e->directory);
    const char *source = json_string_value(json_object_get(json_object_get(e->run, "scene"), "path"));
    if (status == KILN_OK)
        (void)snprintf(e->source, sizeof e->source, "%s",
                       e->job->exported.source != NULL ? e->job->exported.source
                       : source != NULL                ? source
                                                       : "");
    return status == KILN_OK ? check_store(e, error) : status;
}

/* Finds out from run.json which objects have a lightmap of their back. */
static int find_backs(struct export *e, struct kiln_error *error)
{
    const json_t *objects = json_object_get(e->run, "objects");
    for (size_t i = 0; i < e->scene->object_count; i++) {
        const json_t *object = json_array_get(objects, i);
        const char *name = json_string_value(json_object_get(object, "file_name"));
        if (name == NULL || strcmp(name, kiln_scene_string(e->scene, e->scene->objects[i].name)) != 0)
            return kiln_fail(error, KILN_BAD_INPUT,
                             "%.512s/run.json does not list the objects of scene.kscene; bake again", e->directory);
        if (json_object_get(object, "lightmap_back") == NULL)
            continue;
        const int status =
            e->backs != NULL ? KILN_OK : kiln_allocate(&e->backs, e->scene->object_count, 1, "backs", error);
        if (status != KILN_OK)
            return status;
        e->backs[i] = 1;
    }
    return KILN_OK;
}

/* Reads the light at vertices, if the bake has it. */
static int read_light(struct export *e, struct kiln_error *error)
{
    static const char *const dataset = "/vertices/irradiance";
    struct kiln_image *rows = NULL;
    e->vertices = kiln_export_vertices(e->scene);
    if (json_object_get(e->run, "vertices") == NULL || e->vertices == 0)
        return KILN_OK;
    int status;
    KILN_TRY(kiln_results_image(e->results, "kiln.h5", &dataset, 1, &rows, error));
    if (rows->width != e->vertices || kiln_dataset_of(rows, dataset, 2) == NULL)
        KILN_TRY(kiln_fail(error, KILN_BAD_INPUT,
                           "%.512s/kiln.h5 does not have the vertices of scene.kscene; bake again", e->directory));
    KILN_TRY(kiln_allocate(&e->light, (size_t)e->vertices, sizeof *e->light, "irradiance at vertices", error));
    for (uint64_t i = 0; i < 3 * e->vertices; i++) {
        const float value = kiln_dataset_of(rows, dataset, (unsigned)(i % 3))[i / 3];
        e->light[i / 3][i % 3] = value;
        if (!(value >= 0.0f && isfinite(value)))
            KILN_TRY(kiln_fail(error, KILN_BAD_INPUT, "%.512s/kiln.h5: vertex %llu has irradiance %g; bake again",
                               e->directory, (unsigned long long)(i / 3), (double)value));
    }
end:
    kiln_image_destroy(&rows);
    return status;
}

/* Creates the folder of the .glb file unless it exists. */
static int make_folder(struct export *e, struct kiln_error *error)
{
    int status = KILN_OK;
    if (e->job->output == NULL)
        status = kiln_path_join(e->fallback, e->directory, "export/scene.glb", error);
    e->output = e->job->output != NULL ? e->job->output : e->fallback;
    const char *slash = strrchr(e->output, '/'), *dot = strrchr(e->output, '.');
    if (status == KILN_OK && (dot == NULL || strcmp(dot, ".glb") != 0))
        return kiln_fail(error, KILN_USAGE, "--output %.512s: a scene is exported as a .glb file", e->output);
    (void)snprintf(e->folder, sizeof e->folder, "%.*s",
                   slash == NULL        ? 1
                   : slash == e->output ? 1
                                        : (int)(slash - e->output),
                   slash == NULL ? "." : e->output);
    const struct kiln_output_folder_params params = {.directory = e->folder, .kind = KILN_FOLDER_SHARED};
    return status == KILN_OK ? kiln_output_folder_begin(&e->place, &params, error) : status;
}

/* Refuses the folder of the bake: its files are listed in its manifest, and pages would get the names of its lightmaps.
 */
static int check_folder(const struct export *e, struct kiln_error *error)
{
    struct stat a, b;
    if (stat(e->folder, &a) == 0 && stat(e->directory, &b) == 0 && a.st_dev == b.st_dev && a.st_ino == b.st_ino)
        return kiln_fail(
            error, KILN_USAGE,
            "--output %.512s: the bake's own files stay as they were written; name a file in another folder",
            e->output);
    return KILN_OK;
}

static bool is_scene_file(const char *path)
{
    const size_t length = strlen(path);
    return length >= 7 && strcmp(path + length - 7, ".kscene") == 0;
}

static int write_pages(struct export *e, struct kiln_error *error)
{
    const struct kiln_pages_params params = {.directory = e->directory,
                                             .results = e->results,
                                             .folder = e->folder,
                                             .scene = e->scene,
                                             .has_back = e->backs,
                                             .format = (enum kiln_page_format)e->job->exported.format,
                                             .range = e->job->exported.range,
                                             .atlas = e->job->exported.atlas};
    return has_lightmaps(e)
               ? kiln_pages_write(&e->pages, &params, error)
               : kiln_allocate(&e->none, e->scene->object_count, sizeof *e->none, "the export's links", error);
}

static int write_all(struct export *e, struct kiln_error *error)
{
    const int status = write_pages(e, error);
    if (status != KILN_OK)
        return status;
    const bool gltf = kiln_export_has_gltf(e->scene) && !is_scene_file(e->source);
    if (gltf && e->source[0] == '\0')
        return kiln_fail(error, KILN_NO_INPUT,
                         "%.512s/run.json does not say where the scene is that was baked; say it with --scene",
                         e->directory);
    struct kiln_export_params scene = {.source = gltf ? e->source : NULL,
                                       .scene_file = e->scene_file,
                                       .scene = e->scene,
                                       .output = e->output,
                                       .unit = kiln_units_of_bake(e->results)->irradiance_text,
                                       .encoding = kiln_page_encoding((enum kiln_page_format)e->job->exported.format),
                                       .links = e->none,
                                       .light = (const float(*)[3])e->light,
                                       .drop_baked_lights = e->job->exported.drop_baked_lights};
    if (e->pages != NULL) {
        scene.links = e->pages->links;
        scene.pages = e->pages->pages;
        scene.page_count = e->pages->page_count;
        scene.coordinates = e->pages->coordinates;
    }
    return kiln_export_scene(&scene, error);
}

static int tell(const struct export *e, struct kiln_error *error)
{
    const size_t pages = e->pages != NULL ? e->pages->page_count : 0;
    const double used = e->pages != NULL ? e->pages->used : 0.0;
    const uint64_t vertices = e->light != NULL ? e->vertices : 0;
    uint64_t texels = 0;
    char at_vertices[64] = "";
    for (size_t i = 0; i < pages; i++)
        texels += (uint64_t)e->pages->pages[i].width * e->pages->pages[i].height;
    if (e->job->json)
        return kiln_json_print(json_pack("{s:s, s:o, s:I, s:I, s:f, s:I}", "status", "done", "output",
                                         kiln_json_string(e->output), "pages", (json_int_t)pages, "texels",
                                         (json_int_t)texels, "used", used, "vertices", (json_int_t)vertices),
                               error);
    if (vertices > 0)
        (void)snprintf(at_vertices, sizeof at_vertices, ", light at %llu vertices", (unsigned long long)vertices);
    if (!e->job->quiet && e->pages == NULL)
        kiln_print(stdout, "%s: %zu objects, no lightmaps%s\n", e->output, e->scene->object_count, at_vertices);
    else if (!e->job->quiet)
        kiln_print(stdout, "%s: %zu objects, %zu pages, %.2f million texels, %.1f %% of them used%s\n", e->output,
                   e->scene->object_count, pages, 1e-6 * (double)texels, 100.0 * used, at_vertices);
    return KILN_OK;
}

int kiln_command_export(struct kiln_job *job, struct kiln_error *error)
{
    struct export e = {.job = job, .directory = job->arguments[0]};
    int status = read_run(&e, error);
    if (status == KILN_OK)
        status = kiln_path_join(e.scene_file, e.directory, "scene.kscene", error);
    if (status == KILN_OK)
        status = kiln_results_scene(e.results, &e.scene, error);
    if (status == KILN_OK)
        status = find_backs(&e, error);
    if (status == KILN_OK)
        status = make_folder(&e, error);
    if (status == KILN_OK)
        status = check_folder(&e, error);
    const struct kiln_output_name name = {
        .option = "--output", .path = e.output, .inputs = {e.source}, .bakes = {e.directory}};
    if (status == KILN_OK)
        status = kiln_output_name_check(&name, error);
    if (status == KILN_OK)
        status = kiln_lock_refuse(e.directory, error);
    if (status == KILN_OK)
        status = read_light(&e, error);
    if (status == KILN_OK)
        status = write_all(&e, error);
    if (status == KILN_OK)
        status = tell(&e, error);
    kiln_pages_destroy(&e.pages);
    kiln_free(&e.none);
    kiln_free(&e.light);
    kiln_free(&e.backs);
    json_decref(e.run);
    kiln_scene_close(&e.scene);
    kiln_results_close(&e.results);
    kiln_output_folder_end(&e.place, false);
    return status;
}
