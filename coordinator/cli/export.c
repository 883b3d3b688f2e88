/* kiln export DIR: writes the scene with its lightmaps for engines. */
#include "coordinator/export/export.h"

#include <errno.h>
#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "coordinator/run/lock.h"
#include "coordinator/cli/commands.h"
#include "coordinator/files/json.h"
#include "coordinator/files/output_name.h"
#include "coordinator/export/pages.h"
#include "coordinator/files/publish.h"
#include "coordinator/field/units.h"
#include "worker/base/memory.h"
#include "worker/base/text.h"

struct export
{
    const struct kiln_job *job;
    const char *directory, *output;
    char fallback[KILN_PATH_SIZE], folder[KILN_PATH_SIZE], scene_file[KILN_PATH_SIZE], source[KILN_PATH_SIZE];
    struct kiln_results *results;
    struct kiln_scene *scene;
    uint8_t *backs; /* for each object, whether its back has a lightmap; NULL: none has */
    struct kiln_pages *pages;
    json_t *run; /* content of run.json */
};

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
    const json_t *store = json_object_get(json_object_get(e->run, "store"), "kind");
    if (status == KILN_OK && json_is_string(store) && strcmp(json_string_value(store), "lightmap") != 0)
        return kiln_fail(error, KILN_BAD_INPUT,
                         "%.512s has no lightmaps to export: its light is in an octree, in kiln.h5; bake with --store "
                         "lightmap, or with --vertex-light for a scene.glb with light at vertices",
                         e->directory);
    if (status == KILN_OK)
        (void)snprintf(e->source, sizeof e->source, "%s",
                       e->job->source != NULL ? e->job->source
                       : source != NULL       ? source
                                              : "");
    return status;
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
    return status == KILN_OK ? kiln_make_directories(e->folder, error) : status;
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

static int write_all(struct export *e, struct kiln_error *error)
{
    const struct kiln_pages_params params = {.directory = e->directory,
                                             .results = e->results,
                                             .folder = e->folder,
                                             .scene = e->scene,
                                             .has_back = e->backs,
                                             .format = (enum kiln_page_format)e->job->format,
                                             .range = e->job->range,
                                             .atlas = e->job->atlas};
    int status = kiln_pages_write(&e->pages, &params, error);
    if (status != KILN_OK)
        return status;
    const bool gltf = kiln_export_has_gltf(e->scene) && !is_scene_file(e->source);
    if (gltf && e->source[0] == '\0')
        return kiln_fail(error, KILN_NO_INPUT,
                         "%.512s/run.json does not say where the scene is that was baked; say it with --scene",
                         e->directory);
    const struct kiln_export_params scene = {.source = gltf ? e->source : NULL,
                                             .scene_file = e->scene_file,
                                             .scene = e->scene,
                                             .output = e->output,
                                             .unit = kiln_units_of_bake(e->results)->irradiance_text,
                                             .encoding = kiln_page_encoding(params.format),
                                             .links = e->pages->links,
                                             .pages = e->pages->pages,
                                             .page_count = e->pages->page_count,
                                             .coordinates = e->pages->coordinates,
                                             .drop_baked_lights = e->job->drop_baked_lights};
    return kiln_export_scene(&scene, error);
}

static int tell(const struct export *e, struct kiln_error *error)
{
    uint64_t texels = 0;
    for (size_t i = 0; i < e->pages->page_count; i++)
        texels += (uint64_t)e->pages->pages[i].width * e->pages->pages[i].height;
    if (e->job->json)
        return kiln_json_print(json_pack("{s:s, s:o, s:I, s:I, s:f}", "status", "done", "output",
                                         kiln_json_string(e->output), "pages", (json_int_t)e->pages->page_count,
                                         "texels", (json_int_t)texels, "used", e->pages->used),
                               error);
    if (!e->job->quiet)
        kiln_print(stdout, "%s: %zu objects, %zu pages, %.2f million texels, %.1f %% of them used\n", e->output,
                   e->scene->object_count, e->pages->page_count, 1e-6 * (double)texels, 100.0 * e->pages->used);
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
        status = write_all(&e, error);
    if (status == KILN_OK)
        status = tell(&e, error);
    kiln_pages_destroy(&e.pages);
    kiln_free(&e.backs);
    json_decref(e.run);
    kiln_scene_close(&e.scene);
    kiln_results_close(&e.results);
    return status;
}
