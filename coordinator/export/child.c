#include "coordinator/export/child.h"

#include <stdio.h>
#include <string.h>

#include "coordinator/import/child.h"
#include "worker/base/memory.h"

enum { READ_BYTES = 1 << 16 };

void kiln_export_link(struct kiln_glb_build *b, json_t *node, json_t *link)
{
    json_t *extensions = kiln_glb_object(b, node, "extensions"), *extras = kiln_glb_object(b, node, "extras");
    if (extensions != NULL)
        kiln_glb_set(b, extensions, KILN_LIGHTMAP_EXTENSION, json_incref(link));
    if (extras != NULL)
        kiln_glb_set(b, extras, "kiln_lightmap", json_incref(link));
}

void kiln_export_root(struct kiln_glb_build *b, json_t *plan)
{
    json_t *extensions = kiln_glb_object(b, b->root, "extensions");
    if (extensions != NULL)
        kiln_glb_set(b, extensions, KILN_LIGHTMAP_EXTENSION, json_incref(json_object_get(plan, "root")));
    kiln_glb_use(b, KILN_LIGHTMAP_EXTENSION);
}

/* Opens all that comes from the parent, before system calls are restricted. */
static int open_task(struct kiln_export_task *task, struct kiln_error *error)
{
    json_error_t report;
    const int status = kiln_scene_open(&task->scene, task->scene_file, error);
    if (status != KILN_OK)
        return status;
    size_t size = 0, capacity = 0, got = 1;
    while (got > 0) {
        const int grown = kiln_grow(&task->input, &capacity, size + READ_BYTES, 1, "the export's plan", error);
        if (grown != KILN_OK)
            return grown;
        got = fread(task->input + size, 1, READ_BYTES, stdin);
        size += got;
    }
    const size_t length = strnlen(task->input, size), moved = task->scene->vertex_count * sizeof *task->coordinates;
    task->plan = json_loadb(task->input, length, JSON_REJECT_DUPLICATES, &report);
    task->coordinates = task->scene->texcoord_lightmap;
    /* moves the coordinates to the input's beginning, where they are aligned */
    if (length < size && size - length - 1 == moved) {
        memmove(task->input, task->input + length + 1, moved);
        task->coordinates = (const struct kiln_vec2 *)(const void *)task->input;
    }
    if (task->plan == NULL || json_array_size(json_object_get(task->plan, "objects")) != task->scene->object_count)
        return kiln_fail(error, KILN_BUG, "the export's plan does not match the scene file %.512s", task->scene_file);
    return KILN_OK;
}

int kiln_export_child(int argc, char **argv)
{
    struct kiln_error error = {""};
    if (argc != KILN_EXPORT_CHILD_ARGUMENTS) {
        (void)fprintf(stderr, "export-child is not a command for users: kiln starts it itself\n");
        return KILN_USAGE;
    }
    struct kiln_export_task task = {.source = argv[2], .scene_file = argv[3], .output = argv[4]};
    const bool own = argv[2][0] == '\0';
    const struct kiln_import_params limits = {.path = own ? task.scene_file : task.source, .output = task.output};
    int status = open_task(&task, &error);
    if (status == KILN_OK) {
        kiln_child_confine(&limits);
        status = own ? kiln_export_own(&task, &error) : kiln_export_gltf(&task, kiln_child_follower(&limits), &error);
    }
    json_decref(task.plan);
    kiln_free(&task.input);
    kiln_scene_close(&task.scene);
    kiln_child_answer(status, error.message);
    return status;
}
