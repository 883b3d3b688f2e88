#include "coordinator/output/manifest.h"

#include <errno.h>
#include <fcntl.h>
#include <jansson.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "coordinator/mpi/agree.h"
#include "coordinator/files/publish.h"
#include "coordinator/files/json_text.h"
#include "coordinator/field/group_fields.h"
#include "coordinator/output/piece_hash.h"
#include "worker/base/arena.h"
#include "worker/base/calls.h"
#include "worker/base/memory.h"

static const char NAME[] = "manifest";
/* Keys of the hash of a file: of all its bytes, or of its pieces (piece_hash.h), whose size is then there too. */
static const char WHOLE[] = "xxh3_128", PIECES[] = "xxh3_128_of_pieces";
static const json_int_t PIECE_LEAST = 1 << 16; /* limits the number of pieces, which take memory */

static int mpi_failed(struct kiln_error *error)
{
    return kiln_fail(error, KILN_RANK_LOST, "MPI failed while the hashes of the results were gathered");
}

/* ---- one file ---- */

/* Opens a file below the folder, which has been written: it is an I/O error if that fails. */
static int open_written(const char *directory, const char *name, char path[KILN_PATH_SIZE], int *descriptor,
                        struct kiln_error *error)
{
    const int status = kiln_path_join(path, directory, name, error);
    if (status != KILN_OK)
        return status;
    return kiln_open_below(directory, name, O_RDONLY, 0, descriptor, error) == KILN_OK ? KILN_OK : KILN_IO;
}

static int size_of(const char *directory, const char *name, uint64_t *bytes, struct kiln_error *error)
{
    char path[KILN_PATH_SIZE];
    struct stat found;
    int descriptor = -1;
    int status;
    KILN_TRY(open_written(directory, name, path, &descriptor, error));
    if (fstat(descriptor, &found) != 0)
        KILN_TRY(kiln_fail_errno(error, KILN_IO, "'%s' cannot be examined", path));
    *bytes = (uint64_t)found.st_size;
end:
    if (descriptor >= 0)
        (void)close(descriptor);
    return status;
}

static int hash_piece(const char *directory, const struct kiln_manifest_file *file, uint64_t piece,
                      struct kiln_hash *hash, struct kiln_error *error)
{
    char path[KILN_PATH_SIZE];
    int descriptor = -1;
    int status = open_written(directory, file->path, path, &descriptor, error);
    if (status == KILN_OK)
        status = kiln_piece_hash(descriptor, path, file->bytes, KILN_PIECE_BYTES, piece, hash, error);
    if (descriptor >= 0)
        (void)close(descriptor);
    return status;
}

int kiln_manifest_compare(const struct kiln_manifest_file *file, int descriptor, const char *path,
                          struct kiln_error *error)
{
    struct stat found;
    char text[KILN_HASH_TEXT];
    struct kiln_hash hash = {0};
    if (fstat(descriptor, &found) != 0)
        return kiln_fail_errno(error, KILN_BAD_INPUT, "'%s' cannot be examined", path);
    if ((uint64_t)found.st_size != file->bytes) /* compare the size before reading, since the file may be far longer */
        return kiln_fail(error, KILN_BAD_INPUT, "'%s' has %llu bytes and was written with %llu", path,
                         (unsigned long long)found.st_size, (unsigned long long)file->bytes);
    const int status = kiln_piece_hash_file(descriptor, path, file->bytes,
                                            file->piece_bytes > 0 ? file->piece_bytes : UINT64_MAX, &hash, error);
    if (status != KILN_OK)
        return status == KILN_SYSTEM ? status : KILN_BAD_INPUT;
    (void)lseek(descriptor, 0, SEEK_SET);
    kiln_hash_text(hash.high, hash.low, text);
    if (strcmp(text, file->hash) != 0)
        return kiln_fail(error, KILN_BAD_INPUT, "'%s' is not as it was written: its hash is %s and was %s", path, text,
                         file->hash);
    return KILN_OK;
}

/* Checks that the file in the folder agrees with the manifest; KILN_BAD_INPUT if not. */
static int check_file(const struct kiln_manifest_file *file, const char *directory, struct kiln_error *error)
{
    char path[KILN_PATH_SIZE];
    int descriptor = -1;
    int status;
    KILN_TRY(kiln_path_join(path, directory, file->path, error));
    KILN_TRY(kiln_open_below(directory, file->path, O_RDONLY, 0, &descriptor, error));
    KILN_TRY(kiln_manifest_compare(file, descriptor, path, error));
end:
    if (descriptor >= 0)
        (void)close(descriptor);
    return status == KILN_OK ? KILN_OK : KILN_BAD_INPUT;
}

/* ---- writing ---- */

static int name_file(struct kiln_manifest *m, const char *folder, const char *name, const char *ending,
                     struct kiln_error *error)
{
    const size_t room = strlen(folder) + strlen(name) + strlen(ending) + 1;
    char **path = &m->files[m->count].path;
    const int status = kiln_allocate(path, room, 1, "the manifest", error);
    if (status == KILN_OK) {
        (void)snprintf(*path, room, "%s%s%s", folder, name, ending);
        m->count++;
    }
    return status;
}

/* Whether the scene is in parts, so that each has a file in scenes/. */
static bool has_places(const struct kiln_scene *scene)
{
    return scene != NULL && scene->object_count > 0 && kiln_scene_place(scene, 0) > 0;
}

static size_t places_of(const struct kiln_scene *scene)
{
    size_t count = 0;
    for (size_t i = 0; has_places(scene) && i < scene->object_count; i = kiln_scene_place_end(scene, i))
        count++;
    return count;
}

/* Lists the files of the bake; the same on all ranks. */
static int name_files(struct kiln_manifest **manifest, const struct kiln_scene *scene,
                      const struct kiln_surface *surface, const struct kiln_optional_results *parts,
                      struct kiln_error *error)
{
    const char *const others[] = {"run.json",
                                  "scene.kscene",
                                  parts->no_points ? NULL : "kiln.h5",
                                  parts->volume ? "volume.hdf" : NULL,
                                  parts->preview ? "preview.png" : NULL,
                                  parts->scene && !has_places(scene) ? "scene.glb" : NULL};
    const size_t other_count = sizeof others / sizeof *others, maps = surface != NULL ? surface->map_count : 0,
                 group_files = kiln_group_files(parts->groups);
    int status;
    KILN_TRY(kiln_allocate(manifest, 1, sizeof **manifest, "the manifest", error));
    KILN_TRY(kiln_allocate(&(*manifest)->files,
                           other_count + maps * (1 + group_files) + parts->more_count + places_of(scene),
                           sizeof *(*manifest)->files, "the manifest", error));
    for (size_t i = 0; i < parts->more_count; i++)
        KILN_TRY(name_file(*manifest, "", parts->more[i], "", error));
    for (size_t i = 0; i < other_count; i++)
        if (others[i] != NULL)
            KILN_TRY(name_file(*manifest, "", others[i], "", error));
    for (size_t i = 0; parts->scene && has_places(scene) && i < scene->object_count;
         i = kiln_scene_place_end(scene, i)) {
        char name[KILN_PATH_SIZE];
        (void)snprintf(name, sizeof name, "%.*s", (int)kiln_scene_place(scene, i),
                       kiln_scene_string(scene, scene->objects[i].name));
        KILN_TRY(name_file(*manifest, "scenes/", name, ".glb", error));
    }
    for (uint32_t i = 0; i < maps; i++) {
        const struct kiln_object *object = &scene->objects[kiln_map_object(surface, i)];
        const char *folder = kiln_map_back(surface, i) ? "lightmaps/back/" : "lightmaps/";
        const char *name = kiln_scene_string(scene, object->name);
        if (surface->lightmaps[i].published != 0)
            KILN_TRY(name_file(*manifest, folder, name, ".exr", error));
        for (size_t n = 0; n < group_files && surface->lightmaps[i].published != 0; n++) {
            char of_groups[KILN_GROUP_FOLDER + 8];
            kiln_group_folder(n, of_groups);
            (void)strcat(of_groups, kiln_map_back(surface, i) ? "/back/" : "/");
            KILN_TRY(name_file(*manifest, of_groups, name, ".exr", error));
        }
    }
end:
    return status;
}

/* Collective. The sizes of the files, which rank 0 looks up. */
static int find_sizes(const struct kiln_manifest *m, const char *directory, MPI_Comm communicator, int rank,
                      struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t i = 0; rank == 0 && status == KILN_OK && i < m->count; i++)
        status = size_of(directory, m->files[i].path, &m->files[i].bytes, error);
    status = kiln_agree(communicator, status, error);
    for (size_t i = 0; status == KILN_OK && i < m->count; i++)
        if (MPI_Bcast(&m->files[i].bytes, 1, MPI_UINT64_T, 0, communicator) != MPI_SUCCESS)
            status = mpi_failed(error);
    return kiln_agree(communicator, status, error);
}

/* Pieces of all files, one file after the other. */
struct pieces {
    struct kiln_hash *hashes; /* 0 where another rank has computed it */
    uint64_t count;
    uint32_t *file;  /* of each piece */
    uint64_t *first; /* of each file: its first piece */
    struct kiln_arena arena;
};

static int list_pieces(struct pieces *p, const struct kiln_manifest *m, struct kiln_error *error)
{
    int status;
    KILN_TRY(kiln_arena_allocate(&p->arena, &p->first, m->count, sizeof *p->first, "the results' hashes", error));
    for (size_t i = 0; i < m->count; i++) {
        p->first[i] = p->count;
        p->count += kiln_hash_piece_count(m->files[i].bytes, KILN_PIECE_BYTES);
    }
    KILN_TRY(kiln_arena_allocate(&p->arena, &p->hashes, p->count, sizeof *p->hashes, "the results' hashes", error));
    KILN_TRY(kiln_arena_allocate(&p->arena, &p->file, p->count, sizeof *p->file, "the results' hashes", error));
    for (size_t i = 0; i < m->count; i++)
        for (uint64_t k = p->first[i]; k < (i + 1 < m->count ? p->first[i + 1] : p->count); k++)
            p->file[k] = (uint32_t)i;
end:
    return status;
}

static void free_pieces(struct pieces *p) { kiln_arena_release(&p->arena); }

/* Returns the rank that hashes a piece. All ranks wrote a large file, one after the other, so its pieces are assigned
 * in the same order; most are then still in memory of the host that reads them. Pieces of other files are assigned in
 * turn. */
static int hasher_of(const struct pieces *p, const struct kiln_manifest *m, uint64_t piece, int ranks)
{
    const uint32_t file = p->file[piece];
    const uint64_t pieces = kiln_hash_piece_count(m->files[file].bytes, KILN_PIECE_BYTES);
    return (int)(pieces < (uint64_t)ranks ? piece % (uint64_t)ranks
                                          : (piece - p->first[file]) * (uint64_t)ranks / pieces);
}

/* Hashes this rank's pieces, on all its threads. */
static int hash_own(const struct kiln_manifest *m, const struct pieces *p, const char *directory, int rank, int ranks,
                    struct kiln_error *error)
{
    int status = KILN_OK;
#pragma omp parallel for schedule(dynamic, 1)
    for (uint64_t k = 0; k < p->count; k++) {
        struct kiln_error own;
        if (hasher_of(p, m, k, ranks) != rank)
            continue;
        const int failed = hash_piece(directory, &m->files[p->file[k]], k - p->first[p->file[k]], &p->hashes[k], &own);
#pragma omp critical(kiln_hash_own)
        if (failed != KILN_OK && status == KILN_OK)
            status = kiln_fail(error, failed, "%s", own.message);
    }
    return status;
}

static int join(MPI_Comm communicator, int rank, const struct pieces *p, struct kiln_error *error)
{
    enum { AT_ONCE = 1 << 24 };
    for (uint64_t first = 0; first < p->count; first += AT_ONCE) {
        const int part = p->count - first < AT_ONCE ? (int)(p->count - first) : AT_ONCE;
        if (MPI_Reduce(rank == 0 ? MPI_IN_PLACE : p->hashes + first, p->hashes + first, 2 * part, MPI_UINT64_T, MPI_BOR,
                       0, communicator) != MPI_SUCCESS)
            return mpi_failed(error);
    }
    return KILN_OK;
}

static json_t *manifest_json(const struct kiln_manifest *m, const struct pieces *p)
{
    json_t *files = json_array();
    for (size_t i = 0; i < m->count; i++) {
        char text[KILN_HASH_TEXT];
        const struct kiln_manifest_file *file = &m->files[i];
        const uint64_t count = kiln_hash_piece_count(file->bytes, KILN_PIECE_BYTES);
        const struct kiln_hash hash = kiln_piece_hash_join(p->hashes + p->first[i], count);
        kiln_hash_text(hash.high, hash.low, text);
        json_t *entry = json_pack("{s:s, s:I, s:s}", "path", file->path, "bytes", (json_int_t)file->bytes,
                                  count > 1 ? PIECES : WHOLE, text);
        if (count > 1)
            (void)json_object_set_new(entry, "piece", json_integer((json_int_t)KILN_PIECE_BYTES));
        (void)json_array_append_new(files, entry);
    }
    return json_pack("{s:s, s:o}", "kiln", KILN_VERSION, "files", files);
}

static int publish(const struct kiln_manifest *m, const char *directory, const struct pieces *pieces,
                   struct kiln_error *error)
{
    char *text = NULL;
    size_t size = 0;
    json_t *json = manifest_json(m, pieces);
    const bool whole = json_array_size(json_object_get(json, "files")) == m->count;
    int status = kiln_seal(whole ? json : NULL, JSON_INDENT(1), &text, &size, "the manifest", error);
    if (status == KILN_OK)
        status = kiln_publish_bytes_below(directory, NAME, text, size, error);
    kiln_free(&text);
    json_decref(json);
    return status;
}

int kiln_manifest_write(MPI_Comm communicator, const char *directory, const struct kiln_scene *scene,
                        const struct kiln_surface *surface, const struct kiln_optional_results *parts,
                        struct kiln_error *error)
{
    struct kiln_manifest *m = NULL;
    struct pieces pieces = {.count = 0};
    int rank = 0, ranks = 1;
    (void)MPI_Comm_rank(communicator, &rank);
    (void)MPI_Comm_size(communicator, &ranks);
    int status;
    KILN_TRY(kiln_agree(communicator, name_files(&m, scene, surface, parts, error), error));
    KILN_TRY(find_sizes(m, directory, communicator, rank, error));
    KILN_TRY(list_pieces(&pieces, m, error));
    KILN_TRY(hash_own(m, &pieces, directory, rank, ranks, error));
end:
    status = kiln_agree(communicator, status, error);
    if (status == KILN_OK)
        status = join(communicator, rank, &pieces, error);
    if (status == KILN_OK && rank == 0)
        status = publish(m, directory, &pieces, error);
    free_pieces(&pieces);
    kiln_manifest_destroy(&m);
    return kiln_agree(communicator, status, error);
}

int kiln_manifest_remove(const char *directory, struct kiln_error *error)
{
    if (kiln_unlink_below(directory, NAME) != 0 && errno != ENOENT)
        return kiln_fail_errno(error, KILN_CANNOT_CREATE, "cannot replace %s/%s", directory, NAME);
    return KILN_OK;
}

/* ---- removing old files ---- */

static int compare_paths(const void *a, const void *b)
{
    return strcmp(((const struct kiln_manifest_file *)a)->path, ((const struct kiln_manifest_file *)b)->path);
}

static int remove_file(const char *directory, const char *name, struct kiln_error *error)
{
    if (kiln_unlink_below(directory, name) != 0 && errno != ENOENT)
        return kiln_fail_errno(error, KILN_CANNOT_CREATE, "cannot remove %s/%s, which an earlier bake left", directory,
                               name);
    return KILN_OK;
}

/* Removes the folder of a file in lightmaps/FOLDER or in scenes, if nothing is left in it. */
static void remove_folder(const char *directory, const char *name)
{
    char folder[KILN_PATH_SIZE];
    const char *slash = strrchr(name, '/');
    if (slash == NULL || (slash == strchr(name, '/') && strncmp(name, "scenes/", 7) != 0))
        return;
    (void)snprintf(folder, sizeof folder, "%.*s", (int)(slash - name), name);
    (void)kiln_rmdir_below(directory, folder);
}

static bool is_there(const char *directory, const char *name)
{
    char path[KILN_PATH_SIZE];
    struct stat found;
    return kiln_path_join(path, directory, name, NULL) == KILN_OK && lstat(path, &found) == 0;
}

/* Removes the files that `before` lists and `wanted`, which is sorted, does not. */
static int prune_files(const struct kiln_manifest *before, const struct kiln_manifest *wanted, const char *directory,
                       struct kiln_pruned *pruned, struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t i = 0; status == KILN_OK && i < before->count; i++) {
        const struct kiln_manifest_file *file = &before->files[i];
        if (bsearch(file, wanted->files, wanted->count, sizeof *file, compare_paths) != NULL ||
            !is_there(directory, file->path))
            continue;
        if (check_file(file, directory, NULL) == KILN_OK) {
            status = remove_file(directory, file->path, error);
            remove_folder(directory, file->path);
            pruned->removed++;
        } else if (pruned->kept++ == 0) {
            (void)snprintf(pruned->first_kept, sizeof pruned->first_kept, "%s", file->path);
        }
    }
    return status;
}

static bool is_made_by_kiln(const char *directory, const char *name)
{
    enum { BEGINNING = 4096 };
    char bytes[BEGINNING + sizeof KILN_MADE_BY];
    int descriptor = -1;
    if (kiln_open_below(directory, name, O_RDONLY, 0, &descriptor, NULL) != KILN_OK)
        return false;
    const ssize_t got = read(descriptor, bytes, BEGINNING);
    (void)close(descriptor);
    return got > 0 && memmem(bytes, (size_t)got, KILN_MADE_BY, sizeof KILN_MADE_BY - 1) != NULL;
}

/* The manifest of a folder. KILN_NO_INPUT if there is none, KILN_BAD_INPUT if it is damaged. */
static int read_manifest(struct kiln_manifest **manifest, const char *directory, struct kiln_error *error)
{
    char path[KILN_PATH_SIZE], *text = NULL;
    size_t size = 0;
    *manifest = NULL;
    int status;
    KILN_TRY(kiln_path_join(path, directory, NAME, error));
    KILN_TRY(kiln_read_file_below(directory, NAME, KILN_JSON_BYTES_MOST, &text, &size, error));
    KILN_TRY(kiln_manifest_parse(manifest, path, text, size, error));
end:
    kiln_free(&text);
    return status;
}

int kiln_manifest_prune(const char *directory, const struct kiln_scene *scene, const struct kiln_surface *surface,
                        const struct kiln_optional_results *parts, struct kiln_pruned *pruned, struct kiln_error *error)
{
    static const char *const pictures[] = {"report.html", "view.png"};
    struct kiln_manifest *before = NULL, *wanted = NULL;
    *pruned = (struct kiln_pruned){0};
    int status = name_files(&wanted, scene, surface, parts, error);
    if (status == KILN_OK && read_manifest(&before, directory, NULL) == KILN_OK) {
        qsort(wanted->files, wanted->count, sizeof *wanted->files, compare_paths);
        status = prune_files(before, wanted, directory, pruned, error);
    }
    for (size_t i = 0; status == KILN_OK && i < sizeof pictures / sizeof *pictures; i++)
        if (is_made_by_kiln(directory, pictures[i])) {
            status = remove_file(directory, pictures[i], error);
            pruned->removed++;
        }
    kiln_manifest_destroy(&before);
    kiln_manifest_destroy(&wanted);
    return status;
}

int kiln_manifest_look(const char *directory, const struct kiln_scene *scene, const struct kiln_surface *surface,
                       const struct kiln_optional_results *parts, struct kiln_error *error)
{
    static const char *const folders[] = {"lightmaps", "lightmaps/back", "checkpoint", "parts", "scenes"};
    struct kiln_manifest *wanted = NULL;
    int status;
    KILN_TRY(kiln_check_below(directory, NAME, false, error));
    for (size_t i = 0; i < sizeof folders / sizeof *folders; i++)
        KILN_TRY(kiln_check_below(directory, folders[i], true, error));
    KILN_TRY(name_files(&wanted, scene, surface, parts, error));
    for (size_t i = 0; i < wanted->count; i++)
        KILN_TRY(kiln_check_below(directory, wanted->files[i].path, false, error));
end:
    kiln_manifest_destroy(&wanted);
    return status;
}

/* ---- reading ---- */

/* Whether the path stays within the folder and has only valid file names. */
static bool is_inside(const char *path)
{
    const size_t length = strlen(path);
    if (length == 0 || length >= KILN_PATH_SIZE || path[0] == '/')
        return false;
    for (const char *at = path; at != NULL; at = strchr(at, '/'), at = at == NULL ? NULL : at + 1) {
        const size_t step = strcspn(at, "/");
        if (step == 0 || step > NAME_MAX || (step <= 2 && strncmp(at, "..", step) == 0))
            return false;
    }
    return true;
}

static bool is_hash(const char *text)
{
    return strlen(text) == KILN_HASH_TEXT - 1 && strspn(text, "0123456789abcdef") == KILN_HASH_TEXT - 1;
}

static int take_file(struct kiln_manifest *m, const json_t *entry, const char *manifest_path, struct kiln_error *error)
{
    const json_t *whole = json_object_get(entry, WHOLE), *bytes = json_object_get(entry, "bytes");
    const char *path = json_string_value(json_object_get(entry, "path")),
               *hash = json_string_value(whole != NULL ? whole : json_object_get(entry, PIECES));
    const json_int_t piece = whole != NULL ? 0 : json_integer_value(json_object_get(entry, "piece"));
    if (path == NULL || hash == NULL || !is_hash(hash) || !json_is_integer(bytes) || json_integer_value(bytes) < 0 ||
        !is_inside(path) || (whole == NULL && piece < PIECE_LEAST))
        return kiln_fail(error, KILN_BAD_INPUT, "'%s' is not a manifest of kiln: entry %zu of its files is incomplete",
                         manifest_path, m->count);
    struct kiln_manifest_file *file = &m->files[m->count];
    const int status = name_file(m, "", path, "", error);
    if (status == KILN_OK) {
        file->bytes = (uint64_t)json_integer_value(bytes);
        file->piece_bytes = (uint64_t)piece;
        memcpy(file->hash, hash, KILN_HASH_TEXT);
    }
    return status;
}

static int take_files(struct kiln_manifest *m, const json_t *json, const char *path, struct kiln_error *error)
{
    const json_t *files = json_object_get(json, "files");
    if (!json_is_array(files) || json_array_size(files) == 0)
        return kiln_fail(error, KILN_BAD_INPUT, "'%s' is not a manifest of kiln: it lists no files", path);
    int status = kiln_allocate(&m->files, json_array_size(files), sizeof *m->files, "the manifest", error);
    for (size_t i = 0; status == KILN_OK && i < json_array_size(files); i++)
        status = take_file(m, json_array_get(files, i), path, error);
    if (status != KILN_OK)
        return status;
    qsort(m->files, m->count, sizeof *m->files, compare_paths);
    for (size_t i = 1; i < m->count; i++) /* a file listed repeatedly would be read repeatedly */
        if (strcmp(m->files[i - 1].path, m->files[i].path) == 0)
            return kiln_fail(error, KILN_BAD_INPUT, "'%s' is not a manifest of kiln: it lists %.200s twice", path,
                             m->files[i].path);
    return KILN_OK;
}

int kiln_manifest_parse(struct kiln_manifest **manifest, const char *path, const char *text, size_t size,
                        struct kiln_error *error)
{
    *manifest = NULL;
    json_t *json;
    int status = kiln_unseal(&json, text, size, path, error);
    if (status == KILN_BAD_INPUT)
        status = kiln_fail(error, KILN_BAD_INPUT,
                           "'%s' is not as it was written: it does not end with its own hash; the results cannot be "
                           "checked, bake again",
                           path);
    if (status == KILN_OK)
        status = kiln_allocate(manifest, 1, sizeof **manifest, "the manifest", error);
    if (status == KILN_OK)
        status = take_files(*manifest, json, path, error);
    if (status != KILN_OK)
        kiln_manifest_destroy(manifest);
    json_decref(json);
    return status;
}

void kiln_manifest_destroy(struct kiln_manifest **manifest)
{
    if (*manifest == NULL)
        return;
    for (size_t i = 0; i < (*manifest)->count; i++)
        kiln_free(&(*manifest)->files[i].path);
    kiln_free(&(*manifest)->files);
    kiln_free(manifest);
}

bool kiln_folder_of_bake(const char *directory)
{
    static const char *const marks[] = {"run.json", "manifest", "scene.kscene", "checkpoint", "kiln.h5"};
    char path[KILN_PATH_SIZE];
    struct stat found;
    for (size_t i = 0; i < sizeof marks / sizeof *marks; i++)
        if (kiln_path_join(path, directory, marks[i], NULL) == KILN_OK && stat(path, &found) == 0)
            return true;
    return false;
}
