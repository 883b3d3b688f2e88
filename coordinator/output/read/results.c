#include "coordinator/output/read/results.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/openat2.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "coordinator/files/plain_file.h"
#include "coordinator/files/publish.h"
#include "coordinator/files/foreign_json.h"
#include "coordinator/files/json_text.h"
#include "worker/base/calls.h"
#include "worker/base/memory.h"

struct kiln_results {
    const char *directory;
    int descriptor;                 /* descriptor of the folder */
    struct kiln_manifest *manifest; /* sorted by path; NULL: none */
    struct kiln_reader *reader;
};

/* ---- opening ---- */

static int open_below(int folder, const char *name, uint64_t flags)
{
    const struct open_how how = {.flags = flags | O_CLOEXEC,
                                 .resolve = RESOLVE_BENEATH | RESOLVE_NO_SYMLINKS | RESOLVE_NO_MAGICLINKS};
    long descriptor;
    do
        descriptor = syscall(SYS_openat2, folder, name, &how, sizeof how);
    while (descriptor < 0 &&
           (errno == EINTR || errno == EAGAIN)); /* EAGAIN: a path component was renamed at the same time */
    return (int)descriptor;
}

/* The entry of a file in the manifest, or NULL. */
static const struct kiln_manifest_file *find_entry(const struct kiln_manifest *m, const char *name)
{
    size_t low = 0, high = m->count;
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        const int order = strcmp(m->files[middle].path, name);
        if (order == 0)
            return &m->files[middle];
        if (order < 0)
            low = middle + 1;
        else
            high = middle;
    }
    return NULL;
}

static int compare_with_manifest(const struct kiln_results *r, const char *name, int descriptor, const char *path,
                                 struct kiln_error *error)
{
    const struct kiln_manifest_file *file = r->manifest != NULL ? find_entry(r->manifest, name) : NULL;
    if (r->manifest == NULL)
        return KILN_OK;
    if (file == NULL)
        return kiln_fail(
            error, KILN_BAD_INPUT,
            "'%s' is not among the files that the bake wrote, by its manifest: bake again, or remove the manifest",
            path);
    return kiln_manifest_compare(file, descriptor, path, error);
}

int kiln_results_file(const struct kiln_results *r, const char *name, int *descriptor, char path[],
                      struct kiln_error *error)
{
    *descriptor = -1;
    int status = kiln_path_join(path, r->directory, name, error);
    if (status != KILN_OK)
        return KILN_NO_INPUT;
    *descriptor = open_below(r->descriptor, name, O_RDONLY | O_NONBLOCK | O_NOCTTY);
    status = *descriptor < 0 ? kiln_open_failed(path, error) : kiln_keep_plain(descriptor, path, error);
    if (status == KILN_OK)
        status = compare_with_manifest(r, name, *descriptor, path, error);
    if (status != KILN_OK && *descriptor >= 0) {
        (void)close(*descriptor);
        *descriptor = -1;
    }
    return status;
}

bool kiln_results_has(const struct kiln_results *r, const char *name)
{
    const int descriptor = open_below(r->descriptor, name, O_PATH);
    if (descriptor < 0)
        return errno == ELOOP || errno == EXDEV; /* a link counts as present; opening it is an error */
    (void)close(descriptor);
    return true;
}

int kiln_results_folder(const struct kiln_results *r, const char *name, int *descriptor, struct kiln_error *error)
{
    char path[KILN_PATH_SIZE];
    const int status = kiln_path_join(path, r->directory, name, error);
    *descriptor = status == KILN_OK ? open_below(r->descriptor, name, O_RDONLY | O_DIRECTORY) : -1;
    return status != KILN_OK || *descriptor >= 0 ? status : kiln_open_failed(path, error);
}

/* ---- reading ---- */

int kiln_results_bytes(const struct kiln_results *r, const char *name, size_t most, char **bytes, size_t *size,
                       struct kiln_error *error)
{
    char path[KILN_PATH_SIZE];
    int descriptor;
    *bytes = NULL;
    *size = 0;
    int status = kiln_results_file(r, name, &descriptor, path, error);
    if (status == KILN_OK)
        status = kiln_read_open(descriptor, path, most, bytes, size, error);
    if (descriptor >= 0)
        (void)close(descriptor);
    return status;
}

static bool has_channels(const struct kiln_image *image, const struct kiln_field *field)
{
    bool found = field->channels != NULL;
    for (uint32_t c = 0; found && c < field->components; c++)
        found = kiln_image_find(image, field->channels[c]) != NULL;
    return found;
}

int kiln_results_fields(struct kiln_results *r, const char *lightmap, const struct kiln_field **fields, size_t *count,
                        struct kiln_error *error)
{
    size_t rows;
    const struct kiln_field *table = kiln_fields(&rows);
    struct kiln_image *image = NULL;
    *count = 0;
    const int status = kiln_results_image(r, lightmap, NULL, 0, &image, error);
    for (size_t i = 0; status == KILN_OK && i < rows; i++)
        if (has_channels(image, &table[i]))
            fields[(*count)++] = &table[i];
    kiln_image_destroy(&image);
    return status;
}

int kiln_results_json(const struct kiln_results *r, const char *name, json_t **json, struct kiln_error *error)
{
    char path[KILN_PATH_SIZE], *text = NULL;
    size_t size = 0;
    *json = NULL;
    int status;
    KILN_TRY(kiln_results_bytes(r, name, KILN_JSON_BYTES_MOST, &text, &size, error));
    KILN_TRY(kiln_path_join(path, r->directory, name, error));
    KILN_TRY(kiln_foreign_json(json, KILN_JSON_CHILD, text, size, path, error));
end:
    kiln_free(&text);
    return status;
}

int kiln_results_image(struct kiln_results *r, const char *name, const char *const *wanted, size_t count,
                       struct kiln_image **image, struct kiln_error *error)
{
    char path[KILN_PATH_SIZE];
    int descriptor;
    *image = NULL;
    int status = kiln_results_file(r, name, &descriptor, path, error);
    if (status == KILN_OK)
        status = kiln_reader_image(r->reader, descriptor, path, wanted, count, image, error);
    if (descriptor >= 0)
        (void)close(descriptor);
    return status;
}

int kiln_results_scene(const struct kiln_results *r, struct kiln_scene **scene, struct kiln_error *error)
{
    char path[KILN_PATH_SIZE];
    int descriptor;
    *scene = NULL;
    const int status = kiln_results_file(r, "scene.kscene", &descriptor, path, error);
    return status == KILN_OK ? kiln_scene_open_descriptor(scene, descriptor, path, error) : status;
}

/* ---- the folder ---- */

const struct kiln_manifest *kiln_results_manifest(const struct kiln_results *r) { return r->manifest; }

struct kiln_reader *kiln_results_reader(struct kiln_results *r) { return r->reader; }

static int read_manifest(struct kiln_results *r, struct kiln_error *error)
{
    char path[KILN_PATH_SIZE], *text = NULL;
    size_t size = 0;
    int status;
    KILN_TRY(kiln_path_join(path, r->directory, "manifest", error));
    KILN_TRY(kiln_results_bytes(r, "manifest", KILN_JSON_BYTES_MOST, &text, &size, error));
    KILN_TRY(kiln_manifest_parse(&r->manifest, path, text, size, error));
end:
    kiln_free(&text);
    return status == KILN_NO_INPUT ? KILN_OK : status;
}

int kiln_results_open(struct kiln_results **results, const char *directory, struct kiln_error *error)
{
    int status = kiln_allocate(results, 1, sizeof **results, "a bake's folder", error);
    if (status != KILN_OK)
        return status;
    struct kiln_results *r = *results;
    r->directory = directory;
    r->descriptor = kiln_open(directory, O_PATH | O_DIRECTORY | O_CLOEXEC, 0);
    if (r->descriptor < 0)
        status = kiln_fail_errno(error, errno == ENOTDIR ? KILN_NO_INPUT : 0, "'%s' cannot be opened", directory);
    if (status == KILN_OK)
        status = kiln_reader_create(&r->reader, 0, error);
    if (status == KILN_OK)
        status = read_manifest(r, error);
    if (status != KILN_OK)
        kiln_results_close(results);
    return status;
}

void kiln_results_close(struct kiln_results **results)
{
    struct kiln_results *r = *results;
    if (r == NULL)
        return;
    if (r->descriptor >= 0)
        (void)close(r->descriptor);
    kiln_reader_destroy(&r->reader);
    kiln_manifest_destroy(&r->manifest);
    kiln_free(results);
}

const struct kiln_units *kiln_units_of_bake(const struct kiln_results *results)
{
    json_t *run = NULL;
    const struct kiln_units *found = kiln_units_named(NULL);
    if (kiln_results_json(results, "run.json", &run, NULL) == KILN_OK)
        found = kiln_units_named(json_string_value(json_object_get(json_object_get(run, "units"), "kind")));
    json_decref(run);
    return found;
}
