#include "coordinator/import/import.h"

#include <errno.h>
#include <fcntl.h>
#include <link.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>
#include <xxhash.h>

#include "coordinator/import/child.h"
#include "coordinator/confined/confined.h"
#include "coordinator/import/read.h"
#include "coordinator/files/publish.h"
#include "worker/base/calls.h"
#include "worker/base/mapped.h"
#include "worker/base/memory.h"

enum { PATH_SIZE = 4096 + 64, NUMBER_SIZE = 40 };

static double now(void)
{
    struct timespec t;
    (void)clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static const char *program_of(const struct kiln_import_params *params)
{
    return params->program != NULL ? params->program : "/proc/self/exe";
}

/* Build ID: an identifier of the program's contents, which the linker stores in a note of the program. */
struct build_id {
    uint64_t hash;
    bool found;
};

static void find_build_id(struct build_id *id, const char *notes, size_t size)
{
    for (size_t at = 0; at + sizeof(ElfW(Nhdr)) <= size && !id->found;) {
        ElfW(Nhdr) note;
        memcpy(&note, notes + at, sizeof note);
        const size_t name = at + sizeof note, text = name + (note.n_namesz + 3u) / 4u * 4u;
        id->found = note.n_type == NT_GNU_BUILD_ID && note.n_descsz > 0 && text + note.n_descsz <= size &&
                    note.n_namesz == sizeof "GNU" && memcmp(notes + name, "GNU", sizeof "GNU") == 0;
        if (id->found)
            id->hash = XXH3_64bits(notes + text, note.n_descsz);
        at = text + (note.n_descsz + 3u) / 4u * 4u;
    }
}

/* Callback of dl_iterate_phdr: looks only at the first object in the list, which is the program itself. */
static int look_for_build_id(struct dl_phdr_info *object, size_t size, void *id)
{
    (void)size;
    for (size_t i = 0; i < object->dlpi_phnum; i++)
        if (object->dlpi_phdr[i].p_type == PT_NOTE)
            find_build_id(id, (const char *)(uintptr_t)(object->dlpi_addr + object->dlpi_phdr[i].p_vaddr),
                          object->dlpi_phdr[i].p_memsz);
    return 1;
}

/* Hashes the program's build ID or, without one, its bytes. The hash is part of the cache key, since another build may
 * read or lay out differently. */
static int hash_program(const struct kiln_import_params *params, uint64_t *hash, struct kiln_error *error)
{
    struct build_id id = {.found = false};
    if (params->program == NULL)
        (void)dl_iterate_phdr(look_for_build_id, &id);
    *hash = id.hash;
    if (id.found) /* reading the program's tens of megabytes would take longer than a small scene */
        return KILN_OK;
    const int file = kiln_open(program_of(params), O_RDONLY | O_CLOEXEC, 0);
    struct stat status;
    if (file < 0)
        return kiln_fail_errno(error, KILN_SYSTEM, "%s: the program cannot be read", program_of(params));
    void *map = fstat(file, &status) == 0
                    ? mmap(NULL, (size_t)status.st_size, PROT_READ, MAP_PRIVATE | MAP_POPULATE, file, 0)
                    : MAP_FAILED;
    (void)close(file);
    if (map == MAP_FAILED)
        return kiln_fail_errno(error, KILN_SYSTEM, "%s: the program cannot be read", program_of(params));
    *hash = XXH3_64bits(map, (size_t)status.st_size);
    (void)munmap(map, (size_t)status.st_size);
    return KILN_OK;
}

/* ---- the cache ---- */

static bool source_unchanged(struct kiln_confine *confine, const struct kiln_import_params *params,
                             const struct kiln_source *source, const char *path)
{
    struct kiln_file file = {0};
    bool same = false;
    if (source->size == KILN_SOURCE_MISSING)
        return kiln_confine_is_missing(confine, path);
    /* only an environment image is recorded with an absolute path; the cache key holds its name as the user gave it */
    if (path[0] == '/') {
        char *real = params->environment == NULL ? NULL : realpath(params->environment, NULL);
        same = real != NULL && strcmp(real, path) == 0 &&
               kiln_confine_map_named(confine, NULL, path, &file, NULL) == KILN_OK;
        free(real);
    } else {
        same = kiln_confine_map(confine, NULL, path, "", &file, NULL) == KILN_OK;
    }
    if (same) {
        kiln_mapped_watch(file.data, file.size, params->path);
        const XXH128_hash_t hash = XXH3_128bits(file.data, file.size);
        kiln_mapped_forget(file.data);
        same = file.size == source->size && hash.low64 == source->hash[0] && hash.high64 == source->hash[1];
        kiln_file_unmap(&file);
    }
    return same;
}

/* Opens a scene file that this import makes. */
static int open_made(const struct kiln_import_params *params, const char *path, struct kiln_scene **scene,
                     struct kiln_error *error)
{
    if (!params->part)
        return kiln_scene_open(scene, path, error);
    const int descriptor = kiln_open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK, 0);
    *scene = NULL;
    return descriptor < 0 ? kiln_fail_errno(error, 0, "%s: cannot open the scene file", path)
                          : kiln_scene_open_part(scene, descriptor, path, error);
}

/* Whether the output exists, is complete, and was made from these same sources with these settings. */
static bool is_fresh(const struct kiln_import_params *params, uint64_t program)
{
    struct kiln_scene *scene = NULL;
    struct kiln_confine *confine = NULL;
    bool fresh = open_made(params, params->output, &scene, NULL) == KILN_OK &&
                 kiln_confine_create(&confine, params->path, NULL) == KILN_OK && scene->source_count > 0;
    if (fresh) {
        uint64_t key[2];
        kiln_import_key(params, program, scene->sources, scene->source_count, scene->strings, key);
        fresh = memcmp(key, scene->header->import_hash, sizeof key) == 0 &&
                strcmp(confine->name, kiln_scene_string(scene, scene->sources[0].path)) == 0;
    }
    for (size_t i = 0; fresh && i < scene->source_count; i++)
        fresh = source_unchanged(confine, params, &scene->sources[i], kiln_scene_string(scene, scene->sources[i].path));
    kiln_confine_destroy(&confine);
    kiln_scene_close(&scene);
    return fresh;
}

bool kiln_import_is_fresh(const struct kiln_import_params *params)
{
    uint64_t program = 0;
    return hash_program(params, &program, NULL) == KILN_OK && is_fresh(params, program);
}

/* ---- the child ---- */

static double wall_limit(const struct kiln_import_params *params)
{
    struct stat status;
    const double bytes = params->bytes != 0                 ? (double)params->bytes
                         : stat(params->path, &status) == 0 ? (double)status.st_size
                                                            : 0.0;
    return 600.0 + 10.0 * (params->time_limit != 0 ? (double)params->time_limit : bytes / 1e6);
}

static int run_child(const struct kiln_import_params *params, uint64_t program, int file, const char *part,
                     struct kiln_error *error)
{
    char numbers[10][NUMBER_SIZE];
    (void)snprintf(numbers[0], NUMBER_SIZE, "%.17g", params->texels_per_metre);
    (void)snprintf(numbers[1], NUMBER_SIZE, "%u", params->lightmap_size);
    (void)snprintf(numbers[2], NUMBER_SIZE, "%u", params->lightmap_max);
    (void)snprintf(numbers[3], NUMBER_SIZE, "%.17g", params->environment_scale);
    (void)snprintf(numbers[4], NUMBER_SIZE, "%.17g", params->environment_rotation_degrees);
    (void)snprintf(numbers[5], NUMBER_SIZE, "%llu", (unsigned long long)params->memory_limit);
    (void)snprintf(numbers[6], NUMBER_SIZE, "%u", params->time_limit);
    (void)snprintf(numbers[7], NUMBER_SIZE, "%016llx", (unsigned long long)program);
    (void)snprintf(numbers[8], NUMBER_SIZE, "%.17g", params->unit);
    (void)snprintf(numbers[9], NUMBER_SIZE, "%.17g", params->texels);
    const char *environment = params->environment == NULL ? "" : params->environment;
    const char *arguments[KILN_CHILD_ARGUMENTS + 1] = {"kiln",
                                                       "import-child",
                                                       params->path,
                                                       part,
                                                       numbers[0],
                                                       numbers[1],
                                                       numbers[2],
                                                       environment,
                                                       numbers[3],
                                                       numbers[4],
                                                       numbers[5],
                                                       numbers[6],
                                                       numbers[7],
                                                       params->objects == NULL ? "" : params->objects,
                                                       params->trust_normals ? "normals" : "winding",
                                                       params->part          ? "part"
                                                       : params->no_layout   ? "none"
                                                       : params->repack      ? "repack"
                                                       : params->keep_shared ? "keep"
                                                                             : "",
                                                       params->changes == NULL ? "" : params->changes,
                                                       params->up_z ? "z" : "y",
                                                       numbers[8],
                                                       params->strict ? "strict" : "",
                                                       numbers[9],
                                                       NULL};
    const struct kiln_confined_call call = {.program = program_of(params),
                                            .arguments = arguments,
                                            .input = -1,
                                            .output = file,
                                            .subject = params->path,
                                            .what = "importer",
                                            .seconds = wall_limit(params),
                                            .stop = params->stop};
    return kiln_confined_run(&call, error);
}

/* ---- putting the result in place ---- */

/* Opens the new file as readers will, and checks it. */
static int check_made(const struct kiln_import_params *params, const char *opens, const char *name,
                      struct kiln_error *error)
{
    struct kiln_scene *scene = NULL;
    struct kiln_error own = {""};
    const int status = open_made(params, opens, &scene, &own);
    kiln_scene_close(&scene);
    return status == KILN_OK ? KILN_OK
                             : kiln_fail(error, status == KILN_BAD_INPUT ? KILN_BUG : status,
                                         "%s was not written correctly: %s", name, own.message);
}

/* Whether two scene files are equal except for the keys of their imports. */
static bool have_same_scene(const struct kiln_scene *a, const struct kiln_scene *b)
{
    struct kiln_scene_header head[2] = {*a->header, *b->header};
    const size_t bytes = kiln_scene_header_bytes(a->header->version);
    if (a->header->version != b->header->version || a->header->size != b->header->size)
        return false;
    for (int i = 0; i < 2; i++) {
        memset(head[i].import_hash, 0, sizeof head[i].import_hash);
        memset(head[i].content_hash, 0, sizeof head[i].content_hash);
    }
    return memcmp(&head[0], &head[1], bytes) == 0 &&
           memcmp((const char *)a->mapped + bytes, (const char *)b->mapped + bytes, a->header->size - bytes) == 0;
}

/* Whether the file at `path` has the same scene as the new one. If so, it is kept: another build of kiln made it, and a
 * checkpoint beside it, which refers to the hash of the file, stays usable. */
static bool is_scene_there(const char *opens, const char *path)
{
    struct kiln_scene *made = NULL, *there = NULL;
    const bool is_there = kiln_scene_open(&there, path, NULL) == KILN_OK &&
                          kiln_scene_open(&made, opens, NULL) == KILN_OK && have_same_scene(made, there);
    kiln_scene_close(&made);
    kiln_scene_close(&there);
    return is_there;
}

/* ---- a scene file as input ---- */

static int check_settings(const struct kiln_import_params *params, const struct kiln_scene *scene,
                          struct kiln_error *error)
{
    bool fits = !params->repack && !params->keep_shared && !params->no_layout &&
                (params->environment == NULL || params->environment[0] == '\0') &&
                (params->objects == NULL || params->objects[0] == '\0') && params->changes == NULL &&
                !params->trust_normals && !params->up_z && (params->unit == 0.0 || params->unit == 1.0) &&
                params->environment_scale == 1.0 && params->environment_rotation_degrees == 0.0 &&
                (params->texels_per_metre == 0.0 || (float)params->texels_per_metre == scene->header->texels_per_metre);
    for (size_t i = 0; i < scene->object_count && fits; i++) {
        const struct kiln_object *o = &scene->objects[i];
        const uint32_t larger = o->lightmap_width > o->lightmap_height ? o->lightmap_width : o->lightmap_height;
        fits = (params->lightmap_size == 0 ||
                (o->lightmap_width == params->lightmap_size && o->lightmap_height == params->lightmap_size)) &&
               (params->lightmap_max == 0 || larger <= params->lightmap_max);
    }
    if (fits)
        return KILN_OK;
    return kiln_fail(error, KILN_USAGE,
                     "%.512s: in a kiln scene file, lightmap sizes, light, objects, front sides, unit and axes are "
                     "already decided; give "
                     "the original scene to change them",
                     params->path);
}

static int take_scene_file(const struct kiln_import_params *params, int file, bool *same, struct kiln_error *error)
{
    struct kiln_scene *scene = NULL;
    struct stat a, b;
    int status = kiln_scene_open(&scene, params->path, error);
    if (status == KILN_OK)
        status = check_settings(params, scene, error);
    *same = status == KILN_OK && stat(params->path, &a) == 0 && stat(params->output, &b) == 0 && a.st_dev == b.st_dev &&
            a.st_ino == b.st_ino;
    if (status == KILN_OK && !*same)
        status = kiln_write_all(file, scene->mapped, scene->mapped_bytes, 0, params->output, error);
    kiln_scene_close(&scene);
    return status;
}

static bool is_scene_file(const char *path)
{
    const size_t length = strlen(path);
    return length >= 7 && strcmp(path + length - 7, ".kscene") == 0;
}

/* Imports into an open, empty file. */
static int fill(const struct kiln_import_params *params, uint64_t program, int file, const char *name, bool *same,
                struct kiln_error *error)
{
    return is_scene_file(params->path) ? take_scene_file(params, file, same, error)
                                       : run_child(params, program, file, name, error);
}

/* Imports into an unnamed file of this process. */
static int fill_own(const struct kiln_import_params *params, uint64_t program, int file, struct kiln_error *error)
{
    bool same = false;
    const int status = fill(params, program, file, params->output, &same, error);
    return status == KILN_OK ? check_made(params, params->output, "the scene file", error) : status;
}

/* Imports, one process at a time. A process that had to wait may find the file made. */
static int make(const struct kiln_import_params *params, uint64_t program, struct kiln_import_report *report,
                struct kiln_error *error)
{
    const char *slash = strrchr(params->output, '/');
    char folder[KILN_PATH_SIZE];
    struct kiln_publish place;
    int claim = -1;
    bool same = false;
    (void)snprintf(folder, sizeof folder, "%.*s",
                   slash == NULL             ? 1
                   : slash == params->output ? 1
                                             : (int)(slash - params->output),
                   slash == NULL ? "." : params->output);
    int status = kiln_publish_claim(&place, folder, slash == NULL ? params->output : slash + 1, &claim, error);
    if (status != KILN_OK)
        return status;
    if (!is_scene_file(params->path) && is_fresh(params, program))
        report->cached = true;
    else
        status = fill(params, program, claim, place.temporary, &same, error);
    const bool made = status == KILN_OK && !same && !report->cached;
    if (made)
        status = check_made(params, place.opens, params->output, error);
    if (made && status == KILN_OK && (params->part || !is_scene_there(place.opens, params->output)))
        status = kiln_publish_finish(&place, error);
    else
        kiln_publish_abandon(&place);
    (void)close(claim);
    return status;
}

int kiln_import(const struct kiln_import_params *params, struct kiln_import_report *report, struct kiln_error *error)
{
    uint64_t program = 0;
    const double start = now();
    const int own = kiln_own_descriptor(params->output);
    report->cached = false;
    if (access(params->path, F_OK) != 0)
        return kiln_fail_errno(error, errno == EACCES ? KILN_PERMISSION : KILN_NO_INPUT,
                               "%.512s: the scene cannot be opened", params->path);
    const bool scene_file = is_scene_file(params->path);
    /* other processes can find it; an unnamed file belongs to this process alone */
    const bool kept = !scene_file && own < 0;
    int status;
    KILN_TRY(kept ? hash_program(params, &program, error) : KILN_OK);
    if (kept)
        report->cached = is_fresh(params, program);
    if (!report->cached)
        KILN_TRY(own >= 0 ? fill_own(params, program, own, error) : make(params, program, report, error));
end:
    report->seconds = now() - start;
    return status;
}
