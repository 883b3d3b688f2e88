#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <xxhash.h>

#include "coordinator/import/parts_private.h"
#include "worker/base/memory.h"

void kiln_part_hash(const struct kiln_scene *scene, uint64_t hash[2])
{
    struct kiln_scene_header header = *scene->header;
    memset(header.import_hash, 0, sizeof header.import_hash);
    kiln_scene_content_hash(
        &header, (const unsigned char *)scene->mapped + kiln_scene_header_bytes(scene->header->version), hash);
}

static int bad_list(const struct kiln_merger *m)
{
    return kiln_fail(m->error, KILN_BAD_INPUT,
                     "%.512s: is not a list of parts as kiln writes it; give the job that lists them",
                     m->confine->scene);
}

static bool is_name(const char *name)
{
    return name != NULL && name[0] != '\0' && strnlen(name, KILN_PART_NAME + 1) <= KILN_PART_NAME &&
           name[strspn(name, "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_-")] == '\0';
}

static bool are_places(const json_t *places)
{
    for (size_t k = 0; k < json_array_size(places); k++)
        for (size_t i = 0; i < 12; i++)
            if (json_array_size(json_array_get(places, k)) != 12 ||
                !json_is_number(json_array_get(json_array_get(places, k), i)))
                return false;
    return json_array_size(places) > 0;
}

/* Opens the scene file of a part, once the limits on memory have room for it. */
static int open_scene(struct kiln_merger *m, struct kiln_open_part *part)
{
    char file[KILN_PART_NAME + 16];
    struct stat status;
    (void)snprintf(file, sizeof file, "%s.kscene", part->name);
    const int descriptor = kiln_confine_open(m->confine, file, 0);
    if (descriptor < 0 || fstat(descriptor, &status) != 0) {
        const int failed = kiln_fail_errno(m->error, KILN_IO, "part '%s': its scene file cannot be opened", part->name);
        if (descriptor >= 0)
            (void)close(descriptor);
        return failed;
    }
    m->confine->total_bytes += (uint64_t)status.st_size;
    if (m->confine->mapped != NULL)
        m->confine->mapped(m->confine);
    return kiln_scene_open_part(&part->scene, descriptor, file, m->error);
}

static int open_part(struct kiln_merger *m, const json_t *json, struct kiln_open_part *part)
{
    const char *hash = json_string_value(json_object_get(json, "hash"));
    uint64_t found[2];
    char text[33];
    part->name = json_string_value(json_object_get(json, "name"));
    part->places = json_object_get(json, "places");
    if (!is_name(part->name) || !are_places(part->places) || hash == NULL)
        return bad_list(m);
    const int status = open_scene(m, part);
    if (status != KILN_OK)
        return status;
    kiln_part_hash(part->scene, found);
    (void)snprintf(text, sizeof text, "%016llx%016llx", (unsigned long long)found[0], (unsigned long long)found[1]);
    if (strcmp(text, hash) == 0)
        return KILN_OK;
    return kiln_fail(m->error, KILN_IO,
                     "part '%s': its scene file was changed while the scene was put together: nothing else may write "
                     "to this folder; run the same command again",
                     part->name);
}

static int open_parts(struct kiln_merger *m, const json_t *list)
{
    int status = KILN_OK;
    m->count = json_array_size(list);
    if (m->count == 0)
        return bad_list(m);
    status = kiln_allocate(&m->parts, m->count, sizeof *m->parts, "the parts of the scene", m->error);
    for (size_t i = 0; status == KILN_OK && i < m->count; i++)
        status = open_part(m, json_array_get(list, i), &m->parts[i]);
    return status;
}

int kiln_parts_read(struct kiln_confine *confine, struct kiln_builder *builder, bool asked, struct kiln_error *error)
{
    struct kiln_merger m = {.confine = confine, .builder = builder, .error = error};
    struct kiln_file file;
    json_t *root = NULL;
    int status = kiln_confine_map(confine, builder, confine->name, "the list", &file, error);
    if (status != KILN_OK)
        return status;
    root = json_loadb((const char *)file.data, file.size, JSON_REJECT_DUPLICATES, NULL);
    kiln_file_unmap(&file);
    KILN_TRY(open_parts(&m, json_object_get(root, "parts")));
    KILN_TRY(kiln_parts_append(&m));
    KILN_TRY(kiln_parts_place(&m));
    KILN_TRY(kiln_parts_settle(&m, asked));
end:
    for (size_t i = 0; m.parts != NULL && i < m.count; i++)
        kiln_scene_close(&m.parts[i].scene);
    kiln_free(&m.parts);
    kiln_free(&m.text);
    json_decref(root);
    return status;
}
