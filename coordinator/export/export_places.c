#include <stdio.h>
#include <string.h>

#include "coordinator/export/child.h"
#include "coordinator/export/export_private.h"
#include "coordinator/files/folder.h"
#include "worker/base/memory.h"

/* Links of the objects of one place, and their names. */
struct place {
    const struct kiln_export_places *params;
    size_t first, end;
    struct kiln_link *links; /* of all objects of the scene; only those of the place are filled in */
    struct kiln_page_info *pages;
    char (*files)[KILN_EXPORT_NAME]; /* two an object of the place */
};

/* The scene as it is stored: light transport may have replaced its materials. */
static struct kiln_scene stored(const struct kiln_scene *scene)
{
    struct kiln_scene as_stored = *scene;
    as_stored.materials =
        (const void *)((const unsigned char *)scene->mapped + scene->header->sections[KILN_SECTION_MATERIALS].offset);
    return as_stored;
}

/* Fills in the links of the place; returns the number of its pages. */
static size_t link_objects(const struct place *p)
{
    const struct kiln_scene *scene = p->params->scene;
    size_t pages = 0;
    for (size_t i = p->first; i < p->end; i++) {
        const struct kiln_object *o = &scene->objects[i];
        const char *name = kiln_scene_string(scene, o->name);
        char *front = p->files[2 * (i - p->first)], *back = p->files[2 * (i - p->first) + 1];
        if (!kiln_export_is_published(scene, i))
            continue;
        (void)snprintf(front, KILN_EXPORT_NAME, "../lightmaps/%s.exr", name);
        (void)snprintf(back, KILN_EXPORT_NAME, "../lightmaps/back/%s.exr", name);
        p->links[i] = (struct kiln_link){.file = front,
                                         .back = p->params->has_back[i] != 0 ? back : NULL,
                                         .page = (uint32_t)pages,
                                         .scale = {1.0, 1.0}};
        p->pages[pages++] =
            (struct kiln_page_info){.file = front, .width = o->lightmap_width, .height = o->lightmap_height};
    }
    return pages;
}

/* The plan of the place's export (child.h); NULL when out of memory. */
static json_t *plan_of(const struct place *p, size_t page_count)
{
    const struct kiln_export_params params = {
        .scene = p->params->scene, .unit = p->params->unit, .encoding = "exr", .links = p->links, .pages = p->pages};
    json_t *objects = json_array(), *pages = json_array();
    for (size_t i = p->first; i < p->end; i++)
        (void)json_array_append_new(objects, kiln_export_link_json(&params, i));
    for (size_t i = 0; i < page_count; i++)
        (void)json_array_append_new(pages, kiln_export_page_json(&params, i));
    return json_pack("{s:o, s:{s:i, s:o}}", "objects", objects, "root", "version", 1, "pages", pages);
}

/* A file of a place, before it is written. */
struct written {
    struct kiln_export_task task;
    size_t first; /* object */
};

static int write_file(void *context, const char *temporary, int file, struct kiln_error *error)
{
    struct written *w = context;
    w->task.output = temporary;
    return kiln_export_own_place(&w->task, w->first, file, error);
}

static int publish(const struct place *p, const char *name, const float (*light)[3], json_t *plan,
                   struct kiln_error *error)
{
    struct kiln_scene scene = stored(p->params->scene);
    struct written written = {.task = {.scene_file = name,
                                       .scene = &scene,
                                       .plan = plan,
                                       .coordinates = scene.texcoord_lightmap,
                                       .light = light},
                              .first = p->first};
    return kiln_export_publish(p->params->directory, name, write_file, &written, error);
}

static int write_place(struct place *p, const float (*light)[3], struct kiln_error *error)
{
    const struct kiln_scene *scene = p->params->scene;
    const size_t count = p->end - p->first;
    char name[KILN_EXPORT_NAME];
    json_t *plan = NULL;
    int status;
    (void)snprintf(name, sizeof name, "scenes/%.*s.glb", (int)kiln_scene_place(scene, p->first),
                   kiln_scene_string(scene, scene->objects[p->first].name));
    KILN_TRY(kiln_allocate(&p->pages, count, sizeof *p->pages, "the export's links", error));
    KILN_TRY(kiln_allocate(&p->files, 2 * count, sizeof *p->files, "the export's links", error));
    plan = plan_of(p, link_objects(p));
    KILN_TRY(plan != NULL ? KILN_OK : kiln_fail(error, KILN_SYSTEM, "out of memory: the export's plan"));
    KILN_TRY(publish(p, name, light, plan, error));
end:
    json_decref(plan);
    kiln_free(&p->pages);
    kiln_free(&p->files);
    return status;
}

static size_t vertices_of(const struct kiln_scene *scene, size_t first, size_t end)
{
    size_t count = 0;
    for (size_t i = first; i < end; i++)
        count += scene->meshes[scene->objects[i].mesh].vertex_count;
    return count;
}

int kiln_export_places(const struct kiln_export_places *params, struct kiln_error *error)
{
    const struct kiln_scene *scene = params->scene;
    struct place p = {.params = params};
    const float(*light)[3] = params->light;
    int status;
    KILN_TRY(kiln_allocate(&p.links, scene->object_count, sizeof *p.links, "the export's links", error));
    KILN_TRY(kiln_make_parents(params->directory, "scenes/", error));
    for (size_t i = 0, k = 0; i < scene->object_count; i = p.end, k++) {
        p.first = i;
        p.end = kiln_scene_place_end(scene, i);
        if (k % params->ranks == params->rank) {
            KILN_TRY(kiln_stop_asked(params->stop) ? kiln_give_up(error) : KILN_OK);
            KILN_TRY(write_place(&p, light, error));
        }
        light = light == NULL ? NULL : light + vertices_of(scene, i, p.end);
    }
end:
    kiln_free(&p.links);
    return status;
}
