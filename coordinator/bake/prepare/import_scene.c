#include "coordinator/bake/prepare/import_scene.h"

#include <dirent.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "coordinator/bake/prepare/import_params.h"
#include "coordinator/files/json.h"
#include "coordinator/files/publish.h"
#include "coordinator/mpi/agree.h"
#include "worker/base/calls.h"
#include "worker/base/memory.h"

/* The folder of the parts' scene files. */
struct place {
    char folder[KILN_PATH_SIZE];
    bool temporary;
};

/* ---- the folder ---- */

static int make_temporary(struct place *place, struct kiln_error *error)
{
    const char *base = getenv("TMPDIR");
    int status;
    KILN_TRY(
        kiln_path_join(place->folder, base != NULL && base[0] != '\0' ? base : "/tmp", "kiln-parts-XXXXXX", error));
    if (mkdtemp(place->folder) == NULL)
        KILN_TRY(
            kiln_fail_errno(error, KILN_CANNOT_CREATE, "a temporary folder %.500s cannot be created", place->folder));
    place->temporary = true;
end:
    return status;
}

static int find_folder(struct place *place, const char *scene_file, struct kiln_error *error)
{
    char directory[KILN_PATH_SIZE];
    const char *slash = strrchr(scene_file, '/');
    (void)snprintf(directory, sizeof directory, "%.*s",
                   slash == NULL         ? 1
                   : slash == scene_file ? 1
                                         : (int)(slash - scene_file),
                   slash == NULL ? "." : scene_file);
    return kiln_path_join(place->folder, directory, "parts", error);
}

static int make_folder(const struct place *place, struct kiln_error *error)
{
    struct kiln_folder folder;
    const char *slash = strrchr(place->folder, '/');
    char directory[KILN_PATH_SIZE];
    (void)snprintf(directory, sizeof directory, "%.*s", (int)(slash - place->folder), place->folder);
    const int status = kiln_folder_open(&folder, directory, slash + 1, true, error);
    kiln_folder_close(&folder);
    return status;
}

static bool is_listed(const struct kiln_job *job, const char *file)
{
    const size_t length = strlen(file) - strlen(".kscene");
    for (size_t i = 0; i < job->scene.part_count; i++)
        if (strlen(job->scene.parts[i].name) == length && strncmp(job->scene.parts[i].name, file, length) == 0)
            return true;
    return false;
}

/* Whether the file is the scene file of a part. */
static bool is_part(int folder, const char *file)
{
    struct kiln_scene *scene = NULL;
    const int descriptor = openat(folder, file, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOFOLLOW);
    const bool part = descriptor >= 0 && kiln_scene_open_part(&scene, descriptor, file, NULL) == KILN_OK;
    kiln_scene_close(&scene);
    return part;
}

/* Removes the scene files of parts that the job does not list. */
static void clean_folder(const struct kiln_job *job, const struct place *place)
{
    DIR *folder = opendir(place->folder);
    const struct dirent *entry;
    while (folder != NULL && (entry = readdir(folder)) != NULL) {
        const size_t length = strlen(entry->d_name);
        if (length > 7 && strcmp(entry->d_name + length - 7, ".kscene") == 0 && entry->d_name[0] != '.' &&
            !is_listed(job, entry->d_name) && is_part(dirfd(folder), entry->d_name))
            (void)kiln_unlinkat(dirfd(folder), entry->d_name, 0);
    }
    if (folder != NULL)
        (void)closedir(folder);
}

static void remove_temporary(const struct kiln_job *job, const struct place *place)
{
    char path[KILN_PATH_SIZE + KILN_PART_NAME + 16];
    if (!place->temporary)
        return;
    for (size_t i = 0; i < job->scene.part_count; i++) {
        (void)snprintf(path, sizeof path, "%s/%s.kscene", place->folder, job->scene.parts[i].name);
        (void)unlink(path);
    }
    (void)snprintf(path, sizeof path, "%s/%s", place->folder, KILN_PART_LIST);
    (void)unlink(path);
    (void)rmdir(place->folder);
}

/* ---- the steps ---- */

static int import_parts(struct kiln_scene_import *result, const struct place *place, const struct kiln_job *job,
                        uint32_t rank, uint32_t ranks, const struct kiln_stop *stop, struct kiln_error *error)
{
    const struct kiln_import_params base = kiln_job_import_params(job, NULL, stop);
    int status = KILN_OK;
    for (size_t i = rank; status == KILN_OK && i < job->scene.part_count; i += ranks) {
        status = kiln_import_part(&base, &job->scene.parts[i], place->folder, &result->parts[i], error);
        result->parts[i].rank = rank;
    }
    return status;
}

static uint64_t bytes_of(const struct kiln_job *job, const struct place *place)
{
    char path[KILN_PATH_SIZE + KILN_PART_NAME + 16];
    uint64_t sum = 0;
    for (size_t i = 0; i < job->scene.part_count; i++) {
        struct stat status;
        (void)snprintf(path, sizeof path, "%s/%s.kscene", place->folder, job->scene.parts[i].name);
        sum += stat(path, &status) == 0 ? (uint64_t)status.st_size : 0;
    }
    return sum;
}

/* Puts the parts together. Sentences that begin with the list, which the user does not know, begin with the job. */
static int assemble(struct kiln_scene_import *result, const struct place *place, const struct kiln_job *job,
                    const char *scene_file, const struct kiln_stop *stop, struct kiln_error *error)
{
    char list[KILN_PATH_SIZE];
    struct kiln_error own = {""};
    struct kiln_import_params params = kiln_job_import_params(job, scene_file, stop);
    int status;
    KILN_TRY(kiln_path_join(list, place->folder, KILN_PART_LIST, error));
    KILN_TRY(kiln_part_list_write(place->folder, job->scene.parts, result->parts, job->scene.part_count, error));
    params.path = list;
    params.bytes = bytes_of(job, place);
    params.up_z = false; /* the parts have been read */
    params.unit = 0.0;
    params.trust_normals = params.strict = false;
    status = kiln_import(&params, &result->report, &own);
    if (status == KILN_OK)
        clean_folder(job, place);
    else if (strncmp(own.message, list, strlen(list)) == 0)
        (void)kiln_fail(error, status, "%.512s%s", job->scene.file, own.message + strlen(list));
    else
        *error = own;
end:
    return status;
}

static int import_one(struct kiln_scene_import *result, const struct kiln_job *job, const char *scene_file,
                      const struct kiln_stop *stop, struct kiln_error *error)
{
    const struct kiln_import_params params = kiln_job_import_params(job, scene_file, stop);
    return kiln_import(&params, &result->report, error);
}

static int begin(struct kiln_scene_import *result, const struct kiln_job *job, struct kiln_error *error)
{
    *result = (struct kiln_scene_import){0};
    return job->scene.part_count == 0 ? KILN_OK
                                      : kiln_allocate(&result->parts, job->scene.part_count, sizeof *result->parts,
                                                      "the parts of the scene", error);
}

int kiln_scene_import_alone(struct kiln_scene_import *result, const struct kiln_job *job, const char *scene_file,
                            const struct kiln_stop *stop, struct kiln_error *error)
{
    struct place place = {.temporary = false};
    int status;
    KILN_TRY(begin(result, job, error));
    if (result->parts == NULL)
        return import_one(result, job, scene_file, stop, error);
    if (kiln_own_descriptor(scene_file) >= 0) {
        KILN_TRY(make_temporary(&place, error));
    } else {
        KILN_TRY(find_folder(&place, scene_file, error));
        KILN_TRY(make_folder(&place, error));
    }
    KILN_TRY(import_parts(result, &place, job, 0, 1, stop, error));
    KILN_TRY(assemble(result, &place, job, scene_file, stop, error));
end:
    remove_temporary(job, &place);
    return status;
}

/* Collective. Tells all ranks what each has found. */
static int share(struct kiln_scene_import *result, MPI_Comm communicator, size_t count, struct kiln_error *error)
{
    const size_t bytes = count * sizeof *result->parts;
    /* one rank has each, and the others zeros */
    if (bytes > INT_MAX ||
        MPI_Allreduce(MPI_IN_PLACE, result->parts, (int)bytes, MPI_BYTE, MPI_BOR, communicator) != MPI_SUCCESS)
        return kiln_fail(error, KILN_SYSTEM, "%zu parts are too many to tell the ranks of: join some", count);
    return KILN_OK;
}

static int import_on_all(struct kiln_scene_import *result, MPI_Comm communicator, const struct place *place,
                         const struct kiln_job *job, const char *scene_file, const struct kiln_stop *stop,
                         struct kiln_error *error)
{
    int rank, ranks, status;
    (void)MPI_Comm_rank(communicator, &rank);
    (void)MPI_Comm_size(communicator, &ranks);
    KILN_TRY(kiln_agree(communicator, rank == 0 ? make_folder(place, error) : KILN_OK, error));
    KILN_TRY(kiln_agree(communicator, import_parts(result, place, job, (uint32_t)rank, (uint32_t)ranks, stop, error),
                        error));
    KILN_TRY(share(result, communicator, job->scene.part_count, error));
    KILN_TRY(
        kiln_agree(communicator, rank == 0 ? assemble(result, place, job, scene_file, stop, error) : KILN_OK, error));
end:
    return status;
}

int kiln_scene_import(struct kiln_scene_import *result, MPI_Comm communicator, const struct kiln_job *job,
                      const char *scene_file, const struct kiln_stop *stop, struct kiln_error *error)
{
    struct place place = {.temporary = false};
    int rank, ranks, status;
    (void)MPI_Comm_rank(communicator, &rank);
    (void)MPI_Comm_size(communicator, &ranks);
    if (ranks == 1)
        return kiln_scene_import_alone(result, job, scene_file, stop, error);
    KILN_TRY(kiln_agree(communicator, begin(result, job, error), error));
    if (result->parts == NULL)
        return kiln_agree(communicator, rank == 0 ? import_one(result, job, scene_file, stop, error) : KILN_OK, error);
    KILN_TRY(kiln_agree(communicator, find_folder(&place, scene_file, error), error));
    KILN_TRY(import_on_all(result, communicator, &place, job, scene_file, stop, error));
end:
    return status;
}

void kiln_scene_import_release(struct kiln_scene_import *result) { kiln_free(&result->parts); }

/* ---- reports ---- */

void kiln_parts_sentence(const struct kiln_job *job, const struct kiln_part_import *imports, char *text, size_t size)
{
    enum { NAMED = 4 };
    const size_t count = job->scene.part_count;
    size_t read = 0, used;
    for (size_t i = 0; i < count; i++)
        read += imports[i].read;
    (void)snprintf(text, size, "%zu part%s, %zu of them read%s", count, count == 1 ? "" : "s", read,
                   read == 0       ? ""
                   : read == count ? ""
                                   : ": ");
    for (size_t i = 0, named = 0; i < count && read < count && read > 0 && named <= NAMED; i++) {
        if (imports[i].read == 0)
            continue;
        used = strlen(text);
        if (named++ < NAMED)
            (void)snprintf(text + used, size - used, "%s%s", named > 1 ? ", " : "", job->scene.parts[i].name);
        else
            (void)snprintf(text + used, size - used, " and %zu more", read - NAMED);
    }
}

size_t kiln_parts_changed(const struct kiln_job *job, const struct kiln_part_import *imports, uint32_t rank)
{
    size_t i = 0;
    while (i < job->scene.part_count &&
           (imports[i].rank != rank || kiln_part_is_unchanged(&job->scene.parts[i], &imports[i])))
        i++;
    return i;
}

json_t *kiln_parts_report(const struct kiln_job *job, const struct kiln_part_import *imports)
{
    json_t *list = job->scene.part_count > 0 && imports != NULL ? json_array() : NULL;
    for (size_t i = 0; list != NULL && i < job->scene.part_count; i++) {
        const struct kiln_part *part = &job->scene.parts[i];
        (void)json_array_append_new(
            list, json_pack("{s:s, s:o, s:b, s:f, s:i, s:I, s:I, s:I}", "name", part->name, "file",
                            kiln_json_string(part->file), "read", (int)imports[i].read, "seconds", imports[i].seconds,
                            "rank", (int)imports[i].rank, "places", (json_int_t)part->at_count, "objects",
                            (json_int_t)imports[i].objects, "triangles", (json_int_t)imports[i].triangles));
    }
    return list;
}
