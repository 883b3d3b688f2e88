#include "coordinator/export/child.h"

#include <stdio.h>
#include <string.h>

#include "coordinator/export/export.h"
#include "coordinator/import/child.h"
#include "worker/base/memory.h"

enum { READ_BYTES = 1 << 16 };

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
    const size_t length = strnlen(task->input, size);
    task->plan = json_loadb(task->input, length, JSON_REJECT_DUPLICATES, &report);
    task->coordinates = task->scene->texcoord_lightmap;
    const bool has_coordinates = json_is_true(json_object_get(task->plan, "has_coordinates")),
               has_light = json_is_true(json_object_get(task->plan, "has_light"));
    const size_t moved = has_coordinates ? task->scene->vertex_count * sizeof *task->coordinates : 0,
                 light = has_light ? kiln_export_vertices(task->scene) * sizeof *task->light : 0,
                 rest = length < size ? size - length - 1 : 0;
    /* moves the numbers to the input's beginning, where they are aligned */
    if (rest > 0 && rest == moved + light)
        memmove(task->input, task->input + length + 1, rest);
    if (has_coordinates)
        task->coordinates = (const struct kiln_vec2 *)(const void *)task->input;
    if (has_light)
        task->light = (const float(*)[3])(const void *)(task->input + moved);
    if (task->plan == NULL || rest != moved + light ||
        json_array_size(json_object_get(task->plan, "objects")) != task->scene->object_count)
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
