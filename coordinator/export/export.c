#include "coordinator/export/export.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "coordinator/export/child.h"
#include "coordinator/export/export_private.h"
#include "coordinator/confined/confined.h"
#include "coordinator/files/publish.h"
#include "coordinator/import/import.h"
#include "worker/base/calls.h"
#include "worker/base/memory.h"

bool kiln_export_has_gltf(const struct kiln_scene *scene)
{
    const char *path = scene->source_count > 0 ? kiln_scene_string(scene, scene->sources[0].path) : "";
    const char *dot = strrchr(path, '.');
    return (scene->triangle_sources != NULL || scene->triangle_count == 0) && dot != NULL &&
           (strcasecmp(dot, ".glb") == 0 || strcasecmp(dot, ".gltf") == 0);
}

bool kiln_export_is_published(const struct kiln_scene *scene, size_t object)
{
    const struct kiln_object *o = &scene->objects[object];
    return (o->flags & KILN_OBJECT_CASTER_ONLY) == 0 && (scene->meshes[o->mesh].flags & KILN_MESH_NO_LAYOUT) == 0;
}

uint64_t kiln_export_vertices(const struct kiln_scene *scene)
{
    uint64_t count = 0;
    for (size_t i = 0; i < scene->object_count; i++)
        count += scene->meshes[scene->objects[i].mesh].vertex_count;
    return count;
}

uint64_t kiln_export_size(const struct kiln_scene *scene)
{
    enum { VERTEX = 12 + 12 + 8 + 8, CORNER = 4 }; /* bytes of position, normal and two sets of coordinates */
    const bool gltf = kiln_export_has_gltf(scene);
    uint64_t bytes = gltf ? 0 : scene->header->sections[KILN_SECTION_TEXELS].count / 2; /* estimated size as PNG */
    for (size_t i = 0; gltf && i < scene->source_count; i++)
        bytes += scene->sources[i].size != KILN_SOURCE_MISSING ? scene->sources[i].size : 0;
    for (size_t i = 0; i < scene->mesh_count; i++)
        if (!gltf || (scene->meshes[i].flags & KILN_MESH_UNWRAPPED) != 0)
            bytes += scene->meshes[i].vertex_count * VERTEX + 3 * CORNER * scene->meshes[i].triangle_count;
    return bytes;
}

/* ---- the plan ---- */

json_t *kiln_export_link_json(const struct kiln_export_params *p, size_t object)
{
    const struct kiln_link *l = &p->links[object];
    const struct kiln_object *o = &p->scene->objects[object];
    if (l->file == NULL)
        return json_null();
    json_t *json = json_pack("{s:s, s:i, s:i, s:[f, f], s:[f, f], s:s, s:s, s:s}", "file", l->file, "page",
                             (int)l->page, "texCoord", 1, "scale", l->scale[0], l->scale[1], "offset", l->offset[0],
                             l->offset[1], "quantity", "irradiance", "unit", p->unit, "encoding", p->encoding);
    if (p->pages[l->page].range > 0.0)
        (void)json_object_set_new(json, "range", json_real(p->pages[l->page].range));
    if (l->back != NULL)
        (void)json_object_set_new(json, "back",
                                  l->back_range > 0.0 ? json_pack("{s:s, s:f}", "file", l->back, "range", l->back_range)
                                                      : json_pack("{s:s}", "file", l->back));
    if (o->source_node != KILN_NONE)
        (void)json_object_set_new(
            json, "source",
            json_pack("{s:I, s:I}", "node", (json_int_t)o->source_node, "mesh", (json_int_t)o->source_mesh));
    return json;
}

json_t *kiln_export_page_json(const struct kiln_export_params *p, size_t index)
{
    const struct kiln_page_info *page = &p->pages[index];
    json_t *json = json_pack("{s:s, s:I, s:I, s:s}", "file", page->file, "width", (json_int_t)page->width, "height",
                             (json_int_t)page->height, "encoding", p->encoding);
    if (page->range > 0.0)
        (void)json_object_set_new(json, "range", json_real(page->range));
    return json;
}

/* The plan for the child, as text (from malloc). NULL when out of memory. */
static char *plan_text(const struct kiln_export_params *p)
{
    json_t *objects = json_array(), *pages = json_array();
    int failed = 0;
    for (size_t i = 0; i < p->scene->object_count; i++)
        failed |= json_array_append_new(objects, kiln_export_link_json(p, i));
    for (size_t i = 0; i < p->page_count; i++)
        failed |= json_array_append_new(pages, kiln_export_page_json(p, i));
    json_t *plan = json_pack("{s:o, s:{s:i, s:o}, s:b, s:b, s:b}", "objects", objects, "root", "version", 1, "pages",
                             pages, "drop_baked_lights", (int)p->drop_baked_lights, "has_coordinates",
                             p->coordinates != NULL, "has_light", p->light != NULL);
    char *text = failed != 0 || plan == NULL ? NULL : json_dumps(plan, JSON_COMPACT);
    json_decref(plan);
    return text;
}

/* Makes an unnamed file with the plan, positioned at its beginning. */
static int plan_file(const struct kiln_export_params *p, int *descriptor, struct kiln_error *error)
{
    char *text = plan_text(p);
    *descriptor = text == NULL ? -1 : memfd_create("kiln export", MFD_CLOEXEC);
    int status;
    KILN_TRY(text == NULL      ? kiln_fail(error, KILN_SYSTEM, "out of memory: the export's plan")
             : *descriptor < 0 ? kiln_fail_errno(error, KILN_SYSTEM, "cannot create a file in memory")
                               : KILN_OK);
    KILN_TRY(kiln_write_all(*descriptor, text, strlen(text), 0, "the export's plan", error));
    const size_t begin = text == NULL ? 0 : strlen(text) + 1, /* after the zero byte that ends the text */
        moved = p->coordinates == NULL ? 0 : p->scene->vertex_count * sizeof *p->coordinates;
    if (p->coordinates != NULL)
        KILN_TRY(kiln_write_all(*descriptor, p->coordinates, moved, begin, "the export's plan", error));
    if (p->light != NULL)
        KILN_TRY(kiln_write_all(*descriptor, p->light, kiln_export_vertices(p->scene) * sizeof *p->light, begin + moved,
                                "the export's plan", error));
    if (lseek(*descriptor, 0, SEEK_SET) != 0)
        KILN_TRY(kiln_fail_errno(error, KILN_SYSTEM, "cannot read a file in memory"));
end:
    free(text);
    return status;
}

/* ---- the child ---- */

static double wall_limit(const struct kiln_export_params *p)
{
    struct stat status;
    const double bytes = p->source != NULL && stat(p->source, &status) == 0 ? (double)status.st_size : 0.0;
    return 600.0 + 10.0 * (bytes + (double)p->scene->mapped_bytes) / 1e6;
}

static int run_child(const struct kiln_export_params *p, const char *temporary, int output, struct kiln_error *error)
{
    int plan = -1;
    const char *arguments[KILN_EXPORT_CHILD_ARGUMENTS + 1] = {
        "kiln", "export-child", p->source != NULL ? p->source : "", p->scene_file, temporary, NULL};
    int status = plan_file(p, &plan, error);
    if (status == KILN_OK) {
        const struct kiln_confined_call call = {.arguments = arguments,
                                                .input = plan,
                                                .output = output,
                                                .subject = p->source != NULL ? p->source : p->scene_file,
                                                .what = "exporter",
                                                .seconds = wall_limit(p),
                                                .stop = p->stop};
        status = kiln_confined_run(&call, error);
    }
    if (plan >= 0)
        (void)close(plan);
    return status;
}

static int check_written(int file, const char *name, struct kiln_error *error)
{
    unsigned char header[12] = {0};
    struct stat found;
    const bool read = pread(file, header, sizeof header, 0) == (ssize_t)sizeof header && fstat(file, &found) == 0;
    const uint64_t length =
        (uint64_t)header[8] | (uint64_t)header[9] << 8 | (uint64_t)header[10] << 16 | (uint64_t)header[11] << 24;
    if (!read || memcmp(header, "glTF", 4) != 0 || length != (uint64_t)found.st_size)
        return kiln_fail(error, KILN_IO, "%.512s was not written completely", name);
    return KILN_OK;
}

int kiln_export_publish(const char *directory, const char *name,
                        int (*write)(void *context, const char *temporary, int file, struct kiln_error *error),
                        void *context, struct kiln_error *error)
{
    struct kiln_publish place;
    int file = -1, status;
    KILN_TRY(kiln_publish_begin(&place, directory, name, error));
    KILN_TRY(kiln_publish_open(&place, &file, error));
    KILN_TRY(write(context, place.temporary, file, error));
    KILN_TRY(check_written(file, place.temporary, error));
end:
    if (file >= 0 && kiln_close(file) != 0 && status == KILN_OK)
        status = kiln_fail_errno(error, KILN_IO, "%.512s cannot be closed", place.temporary);
    if (status == KILN_OK)
        return kiln_publish_finish(&place, error);
    kiln_publish_abandon(&place);
    return status;
}

static int write_scene(void *context, const char *temporary, int file, struct kiln_error *error)
{
    return run_child(context, temporary, file, error);
}

int kiln_export_scene(const struct kiln_export_params *params, struct kiln_error *error)
{
    struct kiln_export_params own = *params;
    if (params->source != NULL && access(params->source, R_OK) != 0)
        return kiln_fail_errno(error, errno == EACCES ? KILN_PERMISSION : KILN_NO_INPUT,
                               "%.512s: cannot read the scene that was baked; give its path with --scene",
                               params->source);
    return kiln_export_publish(params->directory, params->output, write_scene, &own, error);
}

/* ---- beside a bake ---- */

/* `files`: two per object: of its lightmap and of that of its backs. */
static void own_files(const struct kiln_scene *scene, const uint8_t *has_back, struct kiln_link *links,
                      struct kiln_page_info *pages, char (*files)[KILN_EXPORT_NAME], size_t *page_count)
{
    *page_count = 0;
    for (size_t i = 0; i < scene->object_count; i++) {
        const struct kiln_object *o = &scene->objects[i];
        if (!kiln_export_is_published(scene, i))
            continue;
        (void)snprintf(files[2 * i], KILN_EXPORT_NAME, "lightmaps/%s.exr", kiln_scene_string(scene, o->name));
        (void)snprintf(files[2 * i + 1], KILN_EXPORT_NAME, "lightmaps/back/%s.exr", kiln_scene_string(scene, o->name));
        links[i] = (struct kiln_link){.file = files[2 * i],
                                      .back = has_back != NULL && has_back[i] != 0 ? files[2 * i + 1] : NULL,
                                      .page = (uint32_t)*page_count,
                                      .scale = {1.0, 1.0}};
        pages[(*page_count)++] =
            (struct kiln_page_info){.file = files[2 * i], .width = o->lightmap_width, .height = o->lightmap_height};
    }
}

int kiln_export_beside(const char *directory, const char *path, const struct kiln_scene *scene, const uint8_t *has_back,
                       const float (*light)[3], const char *unit, const struct kiln_stop *stop,
                       struct kiln_error *error)
{
    char scene_file[KILN_PATH_SIZE];
    struct kiln_link *links = NULL;
    struct kiln_page_info *pages = NULL;
    char(*files)[KILN_EXPORT_NAME] = NULL;
    const size_t length = strlen(path);
    const bool scene_itself = length >= 7 && strcmp(path + length - 7, ".kscene") == 0;
    struct kiln_export_params params = {.source = kiln_export_has_gltf(scene) && !scene_itself ? path : NULL,
                                        .scene_file = scene_file,
                                        .scene = scene,
                                        .directory = directory,
                                        .output = "scene.glb",
                                        .light = light,
                                        .unit = unit,
                                        .encoding = "exr",
                                        .stop = stop};
    int status;
    KILN_TRY(kiln_path_join(scene_file, directory, "scene.kscene", error));
    KILN_TRY(kiln_allocate(&links, scene->object_count, sizeof *links, "the export's links", error));
    KILN_TRY(kiln_allocate(&pages, scene->object_count, sizeof *pages, "the export's links", error));
    KILN_TRY(kiln_allocate(&files, 2 * scene->object_count, sizeof *files, "the export's links", error));
    own_files(scene, has_back, links, pages, files, &params.page_count);
    params.links = links;
    params.pages = pages;
    KILN_TRY(kiln_export_scene(&params, error));
end:
    kiln_free(&files);
    kiln_free(&pages);
    kiln_free(&links);
    return status;
}
