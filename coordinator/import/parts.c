#include "coordinator/import/parts.h"

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "coordinator/files/publish.h"
#include "worker/base/calls.h"

/* ---- one part ---- */

static bool is_obj(const char *path)
{
    const size_t length = strlen(path);
    return length > 4 && strcasecmp(path + length - 4, ".obj") == 0;
}

/* Settings that concern single files; the others have their defaults, so that no change of them reads a part again. */
static struct kiln_import_params params_of(const struct kiln_import_params *base, const struct kiln_part *part,
                                           const char *output)
{
    const bool obj = is_obj(part->file);
    return (struct kiln_import_params){.path = part->file,
                                       .output = output,
                                       .part = true,
                                       .environment_scale = 1.0,
                                       .trust_normals = base->trust_normals,
                                       .up_z = obj && base->up_z,
                                       .unit = obj ? base->unit : 0.0,
                                       .strict = base->strict,
                                       .memory_limit = base->memory_limit,
                                       .time_limit = base->time_limit,
                                       .program = base->program,
                                       .stop = base->stop};
}

static bool stamp(const struct kiln_part *part, struct kiln_part_import *result)
{
    struct stat status;
    if (stat(part->file, &status) != 0)
        return false;
    result->size = (uint64_t)status.st_size;
    result->device = (uint64_t)status.st_dev;
    result->inode = (uint64_t)status.st_ino;
    result->modified_seconds = (int64_t)status.st_mtim.tv_sec;
    result->modified_nanoseconds = (int64_t)status.st_mtim.tv_nsec;
    return true;
}

bool kiln_part_is_unchanged(const struct kiln_part *part, const struct kiln_part_import *result)
{
    struct kiln_part_import now = *result;
    return stamp(part, &now) && memcmp(&now, result, sizeof now) == 0;
}

static int look_at_scene(const char *path, struct kiln_part_import *result, struct kiln_error *error)
{
    struct kiln_scene *scene = NULL;
    const int descriptor = kiln_open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK, 0);
    if (descriptor < 0)
        return kiln_fail_errno(error, KILN_IO, "%s cannot be opened", path);
    const int status = kiln_scene_open_part(&scene, descriptor, path, error);
    if (status == KILN_OK) {
        kiln_part_hash(scene, result->hash);
        result->objects = scene->object_count;
        result->triangles = scene->triangle_count;
    }
    kiln_scene_close(&scene);
    return status;
}

static int import(const struct kiln_import_params *params, const struct kiln_part *part,
                  struct kiln_part_import *result, struct kiln_error *error)
{
    struct kiln_import_report report;
    int status;
    KILN_TRY(kiln_import(params, &report, error));
    (void)stamp(part, result); /* before the check, so that the stamp is that of what was read */
    result->read = !report.cached;
    result->seconds = report.seconds;
    if (!report.cached && !kiln_import_is_fresh(params))
        KILN_TRY(kiln_fail(error, KILN_IO,
                           "%.500s, or a file that it refers to, changed while it was read: run the same command again "
                           "when nothing writes to it",
                           part->file));
    KILN_TRY(look_at_scene(params->output, result, error));
end:
    return status;
}

int kiln_import_part(const struct kiln_import_params *base, const struct kiln_part *part, const char *folder,
                     struct kiln_part_import *result, struct kiln_error *error)
{
    char path[KILN_PATH_SIZE], file[KILN_PART_NAME + 16];
    struct kiln_error own = {""};
    *result = (struct kiln_part_import){0};
    (void)snprintf(file, sizeof file, "%s.kscene", part->name);
    int status = kiln_path_join(path, folder, file, error);
    if (status != KILN_OK)
        return status;
    const struct kiln_import_params params = params_of(base, part, path);
    status = import(&params, part, result, &own);
    if (status == KILN_STOPPED)
        *error = own;
    return status == KILN_OK || status == KILN_STOPPED
               ? status
               : kiln_fail(error, status, "part '%s': %s", part->name, own.message);
}

/* ---- the list ---- */

static json_t *places_json(const struct kiln_part *part)
{
    json_t *places = json_array();
    for (size_t k = 0; k < part->at_count; k++) {
        json_t *numbers = json_array();
        for (int i = 0; i < 12; i++)
            (void)json_array_append_new(numbers, json_real(part->at[k][i]));
        (void)json_array_append_new(places, numbers);
    }
    return places;
}

int kiln_part_list_write(const char *folder, const struct kiln_part *parts, const struct kiln_part_import *imports,
                         size_t count, struct kiln_error *error)
{
    json_t *list = json_array();
    for (size_t i = 0; i < count; i++) {
        char hash[33];
        (void)snprintf(hash, sizeof hash, "%016llx%016llx", (unsigned long long)imports[i].hash[0],
                       (unsigned long long)imports[i].hash[1]);
        (void)json_array_append_new(
            list, json_pack("{s:s, s:s, s:o}", "name", parts[i].name, "hash", hash, "places", places_json(&parts[i])));
    }
    json_t *root = json_pack("{s:o}", "parts", list);
    char *text = json_array_size(list) == count ? json_dumps(root, JSON_COMPACT) : NULL;
    json_decref(root);
    if (text == NULL)
        return kiln_fail(error, KILN_SYSTEM, "out of memory: the list of parts");
    const int status = kiln_publish_bytes_below(folder, KILN_PART_LIST, text, strlen(text), error);
    free(text);
    return status;
}
