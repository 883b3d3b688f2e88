#include "coordinator/run/checkpoint.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <xxhash.h>

#include "coordinator/run/checkpoint_private.h"
#include "coordinator/mpi/agree.h"
#include "coordinator/mpi/assert_same.h"
#include "worker/base/calls.h"
#include "worker/base/memory.h"

enum { MANIFEST_MOST = 1 << 28, PARTS_MOST = 1 << 20 }; /* largest size in bytes, and largest number of files */

static int damaged(struct kiln_error *error, const char *path, const char *how)
{
    return kiln_fail(error, KILN_IO, "'%s' %s", path, how);
}

/* Opens a file of `generation`; `path` receives its name, for messages. */
static int open_part(const struct kiln_checkpoint *c, uint64_t generation, size_t part, char path[KILN_PATH_SIZE],
                     int *descriptor, uint64_t *size, struct kiln_error *error)
{
    char name[CHECKPOINT_NAME];
    struct stat found;
    checkpoint_file_name(name, false, generation, part);
    *descriptor = -1;
    int status = kiln_path_join(path, c->directory, name, error);
    if (status == KILN_OK)
        status = kiln_open_below(c->directory, name, O_RDONLY, 0, descriptor, error);
    if (status != KILN_OK)
        return KILN_IO; /* whatever the error was, the generation counts as damaged */
    if (fstat(*descriptor, &found) != 0)
        return kiln_fail_errno(error, KILN_IO, "'%s' cannot be examined", path);
    *size = (uint64_t)found.st_size;
    return KILN_OK;
}

static int read_at(int descriptor, const char *path, uint64_t offset, uint64_t size, void *bytes,
                   struct kiln_error *error)
{
    char *next = bytes;
    while (size > 0) {
        const ssize_t got =
            pread(descriptor, next, size < (uint64_t)1 << 30 ? (size_t)size : (size_t)1 << 30, (off_t)offset);
        if (got < 0 && errno == EINTR)
            continue;
        if (got < 0)
            return kiln_fail_errno(error, KILN_IO, "'%s' cannot be read at byte %llu", path,
                                   (unsigned long long)offset);
        if (got == 0)
            return damaged(error, path, "is shorter than it was");
        next += got;
        offset += (uint64_t)got;
        size -= (uint64_t)got;
    }
    return KILN_OK;
}

static bool read_block(const json_t *json, struct checkpoint_array *b)
{
    const char *name = NULL;
    json_int_t n[4];
    if (json_unpack((json_t *)(uintptr_t)json, "[s,I,I,I,I]", &name, &n[0], &n[1], &n[2], &n[3]) != 0 ||
        strlen(name) >= sizeof b->name || n[0] < 0 || n[1] < 0 || n[2] <= 0 || n[3] < 0)
        return false;
    *b = (struct checkpoint_array){
        .first = (uint64_t)n[0], .count = (uint64_t)n[1], .size = (uint64_t)n[2], .offset = (uint64_t)n[3]};
    memcpy(b->name, name, strlen(name));
    return true;
}

/* `room`: for the arrays of the file. */
static bool read_part_entry(const json_t *json, struct checkpoint_entry *part, struct checkpoint_array *room)
{
    const json_t *blocks = json_object_get(json, "blocks");
    const char *hash = json_string_value(json_object_get(json, "xxh3_128"));
    const json_int_t bytes = json_integer_value(json_object_get(json, "bytes"));
    part->bytes = (uint64_t)bytes;
    part->array_count = (uint32_t)json_array_size(blocks);
    if (hash == NULL || strlen(hash) != 32 || bytes < 0 || json_array_size(blocks) > KILN_ARRAYS_MAX)
        return false;
    memcpy(part->hash, hash, sizeof part->hash);
    for (uint32_t i = 0; i < part->array_count; i++) {
        struct checkpoint_array *b = &room[i];
        if (!read_block(json_array_get(blocks, i), b) || b->offset > part->bytes ||
            b->count > (part->bytes - b->offset) / b->size)
            return false;
    }
    return true;
}

static int read_parts(struct kiln_checkpoint *c, const char *path, const json_t *parts, struct kiln_error *error)
{
    size_t count = 0;
    for (size_t i = 0; i < c->part_count; i++)
        count += json_array_size(json_object_get(json_array_get(parts, i), "blocks"));
    int status = kiln_allocate(&c->parts, c->part_count, sizeof *c->parts, "a checkpoint's table of files", error);
    if (status == KILN_OK)
        status = kiln_allocate(&c->blocks, count > 0 ? count : 1, sizeof *c->blocks, "a checkpoint's table of arrays",
                               error);
    count = 0;
    for (size_t i = 0; status == KILN_OK && i < c->part_count; i++) {
        struct checkpoint_entry *part = &c->parts[i];
        part->first_array = count;
        if (!read_part_entry(json_array_get(parts, i), part, c->blocks + count))
            return damaged(error, path, "is not a checkpoint's manifest");
        count += part->array_count;
    }
    return status;
}

/* Every rank: parses the text of the manifest into the table of files. */
static int parse_manifest(struct kiln_checkpoint *c, const char *path, const char *text, size_t size,
                          struct kiln_error *error)
{
    static const char *const order = __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__ ? "little" : "big";
    const int status = kiln_unseal(&c->manifest, text, size, path, error);
    if (status != KILN_OK)
        return status == KILN_BAD_INPUT ? damaged(error, path, "is cut off or damaged: it does not end with its hash")
                                        : status;
    const json_t *format = json_object_get(c->manifest, "format"), *parts = json_object_get(c->manifest, "parts");
    const char *written_by = json_string_value(json_object_get(c->manifest, "kiln"));
    const char *written_order = json_string_value(json_object_get(c->manifest, "byte_order"));
    if (!json_is_integer(format))
        return damaged(error, path, "is not a checkpoint's manifest");
    if (json_integer_value(format) != KILN_CHECKPOINT_FORMAT)
        return kiln_fail(
            error, KILN_BAD_INPUT,
            "the checkpoint %s is of format %lld, and kiln %s reads format %d: finish it with kiln %s, or give "
            "--no-resume to start from the beginning",
            path, (long long)json_integer_value(format), KILN_VERSION, (int)KILN_CHECKPOINT_FORMAT,
            written_by != NULL ? written_by : "of that time");
    if (written_order == NULL || strcmp(written_order, order) != 0)
        return kiln_fail(
            error, KILN_BAD_INPUT,
            "the checkpoint %s was written by a machine with another byte order: give --no-resume to start "
            "from the beginning",
            path);
    if (json_array_size(parts) == 0 || json_array_size(parts) > PARTS_MOST)
        return damaged(error, path, "is not a checkpoint's manifest");
    c->part_count = json_array_size(parts);
    return read_parts(c, path, parts, error);
}

/* Collective: rank 0 reads the manifest and broadcasts it. */
static int broadcast_manifest(struct kiln_checkpoint *c, uint64_t generation, struct kiln_error *error)
{
    char path[KILN_PATH_SIZE], name[CHECKPOINT_NAME], *text = NULL;
    size_t size = 0;
    checkpoint_manifest_name(name, false, generation);
    int status = kiln_path_join(path, c->directory, name, error);
    if (status == KILN_OK)
        (void)snprintf(c->path, sizeof c->path, "%.*s", (int)(strrchr(path, '/') - path), path);
    if (status == KILN_OK && c->rank == 0)
        status = kiln_read_file_below(c->directory, name, MANIFEST_MOST, &text, &size, error);
    if (status != KILN_OK && status != KILN_SYSTEM)
        status = KILN_IO; /* whatever the error was, the generation counts as damaged */
    status = kiln_agree(c->communicator, status, error);
    uint64_t length = size;
    (void)MPI_Bcast(&length, 1, MPI_UINT64_T, 0, c->communicator);
    if (status == KILN_OK && c->rank != 0)
        status = kiln_allocate(&text, (size_t)length + 1, 1, "a checkpoint's manifest", error);
    status = kiln_agree(c->communicator, status, error);
    if (status == KILN_OK) {
        (void)MPI_Bcast(text, (int)length, MPI_BYTE, 0, c->communicator);
        status = kiln_agree(c->communicator, parse_manifest(c, path, text, (size_t)length, error), error);
    }
    kiln_free(&text);
    return status;
}

static int verify_part(const struct kiln_checkpoint *c, uint64_t generation, size_t part, void *buffer, size_t room,
                       XXH3_state_t *hash, struct kiln_error *error)
{
    char path[KILN_PATH_SIZE], digits[KILN_HASH_TEXT];
    int descriptor = -1;
    uint64_t size = 0;
    int status = open_part(c, generation, part, path, &descriptor, &size, error);
    if (status == KILN_OK && size != c->parts[part].bytes)
        status = kiln_fail(error, KILN_IO, "'%s' has %llu bytes instead of %llu", path, (unsigned long long)size,
                           (unsigned long long)c->parts[part].bytes);
    (void)XXH3_128bits_reset(hash);
    for (uint64_t at = 0; at < size && status == KILN_OK; at += room) {
        const uint64_t step = size - at < room ? size - at : room;
        status = read_at(descriptor, path, at, step, buffer, error);
        if (status == KILN_OK)
            (void)XXH3_128bits_update(hash, buffer, (size_t)step);
    }
    if (descriptor >= 0)
        (void)close(descriptor);
    if (status != KILN_OK)
        return status;
    const XXH128_hash_t value = XXH3_128bits_digest(hash);
    kiln_hash_text(value.high64, value.low64, digits);
    return strcmp(digits, c->parts[part].hash) == 0
               ? KILN_OK
               : damaged(error, path, "is damaged: its hash is not the manifest's");
}

/* Collective: each file is read and checked by one rank. */
static int verify_parts(const struct kiln_checkpoint *c, uint64_t generation, struct kiln_error *error)
{
    enum { ROOM = 1 << 20 };
    void *buffer = NULL;
    XXH3_state_t *hash = XXH3_createState();
    int status;
    KILN_TRY(kiln_allocate(&buffer, ROOM, 1, "checking a checkpoint", error));
    if (hash == NULL)
        KILN_TRY(kiln_fail(error, KILN_SYSTEM, "out of memory: checking a checkpoint"));
    for (size_t i = (size_t)c->rank; i < c->part_count; i += (size_t)c->ranks)
        KILN_TRY(verify_part(c, generation, i, buffer, ROOM, hash, error));
end:
    kiln_free(&buffer);
    (void)XXH3_freeState(hash);
    return kiln_agree(c->communicator, status, error);
}

static void forget(struct kiln_checkpoint *c)
{
    json_decref(c->manifest);
    c->manifest = NULL;
    kiln_free(&c->parts);
    kiln_free(&c->blocks);
    c->part_count = 0;
    c->generation = 0;
}

/* Collective: opens a generation. KILN_IO: it is damaged. */
static int try_generation(struct kiln_checkpoint *c, uint64_t generation, struct kiln_error *error)
{
    int status = broadcast_manifest(c, generation, error);
    if (status == KILN_OK)
        status = verify_parts(c, generation, error);
    if (status == KILN_OK)
        c->generation = generation;
    else
        forget(c);
    return status;
}

/* Rank 0: removes what killed writers left, and lists the generations, newest first. */
static int survey(const struct kiln_checkpoint *c, uint64_t **generations, size_t *count, struct kiln_error *error)
{
    uint64_t *unfinished = NULL;
    size_t unfinished_count = 0;
    int status = checkpoint_list(c->directory, true, &unfinished, &unfinished_count, error);
    for (size_t i = 0; status == KILN_OK && i < unfinished_count; i++)
        checkpoint_remove_generation(c->directory, true, unfinished[i]);
    kiln_free(&unfinished);
    return status == KILN_OK ? checkpoint_list(c->directory, false, generations, count, error) : status;
}

int kiln_checkpoint_open(struct kiln_checkpoint **checkpoint, MPI_Comm communicator, const char *directory, bool take,
                         struct kiln_error *error)
{
    struct kiln_checkpoint *c = NULL;
    uint64_t *generations = NULL, count = 0;
    size_t found = 0;
    *checkpoint = NULL;
    kiln_assert_same_text(communicator, directory, "the folder of a bake");
    kiln_assert_same(communicator, take, "whether a checkpoint is opened");
    int status = kiln_allocate(&c, 1, sizeof *c, "the checkpoint", error);
    if (status == KILN_OK) {
        c->communicator = communicator;
        (void)MPI_Comm_rank(communicator, &c->rank);
        (void)MPI_Comm_size(communicator, &c->ranks);
        (void)snprintf(c->place, sizeof c->place, "%s", directory);
        if (snprintf(c->directory, sizeof c->directory, "%s", directory) >= (int)sizeof c->directory)
            status = kiln_fail(error, KILN_CANNOT_CREATE, "the path '%.200s...' is too long", directory);
        if (status == KILN_OK && c->rank == 0)
            status = survey(c, &generations, &found, error);
    }
    status = kiln_agree(communicator, status, error);
    count = found;
    (void)MPI_Bcast(&count, 1, MPI_UINT64_T, 0, communicator);
    for (uint64_t i = 0; status == KILN_OK && i < (take ? count : count > 0) && c->generation == 0; i++) {
        uint64_t generation = c->rank == 0 ? generations[i] : 0;
        (void)MPI_Bcast(&generation, 1, MPI_UINT64_T, 0, communicator);
        c->newest = i == 0 ? generation : c->newest;
        if (!take)
            break;
        struct kiln_error reason = {{0}};
        status = try_generation(c, generation, &reason);
        if (status == KILN_IO) {
            if (c->rank == 0)
                (void)fprintf(
                    stderr, "kiln: warning: the checkpoint's generation %llu is not whole, so it is passed over: %s\n",
                    (unsigned long long)generation, reason.message);
            status = KILN_OK;
        } else if (status != KILN_OK) {
            (void)kiln_fail(error, status, "%s", reason.message);
        }
    }
    if (c != NULL && c->rank == 0 && c->generation != 0)
        for (size_t i = 0; i < found && generations[i] > c->generation; i++)
            checkpoint_remove_generation(c->directory, false, generations[i]);
    kiln_free(&generations);
    *checkpoint = c;
    if (status != KILN_OK)
        kiln_checkpoint_close(checkpoint);
    return status;
}

void kiln_checkpoint_close(struct kiln_checkpoint **checkpoint)
{
    if (*checkpoint == NULL)
        return;
    if ((*checkpoint)->local != NULL)
        checkpoint_local_close(*checkpoint);
    forget(*checkpoint);
    kiln_free(checkpoint);
}

uint64_t kiln_checkpoint_generation(const struct kiln_checkpoint *c) { return c->generation; }
const json_t *kiln_checkpoint_identity(const struct kiln_checkpoint *c)
{
    return json_object_get(c->manifest, "identity");
}
double kiln_checkpoint_written(const struct kiln_checkpoint *c)
{
    return json_real_value(json_object_get(c->manifest, "written"));
}
size_t kiln_checkpoint_files(const struct kiln_checkpoint *c) { return c->part_count; }

static const struct checkpoint_array *find_array(const struct kiln_checkpoint *c, size_t part, const char *name)
{
    const struct checkpoint_array *blocks = c->blocks + c->parts[part].first_array;
    for (uint32_t i = 0; i < c->parts[part].array_count; i++)
        if (strcmp(blocks[i].name, name) == 0)
            return &blocks[i];
    return NULL;
}

bool kiln_checkpoint_has(const struct kiln_checkpoint *c, const char *name)
{
    for (size_t i = 0; i < c->part_count; i++)
        if (find_array(c, i, name) != NULL)
            return true;
    return false;
}

void kiln_checkpoint_file_range(const struct kiln_checkpoint *c, size_t part, const char *name, uint64_t *first,
                                uint64_t *count)
{
    const struct checkpoint_array *b = find_array(c, part, name);
    *first = b != NULL ? b->first : 0;
    *count = b != NULL ? b->count : 0;
}

/* Reads bytes of an array from one file. */
static int read_from(const struct kiln_checkpoint *c, size_t part, uint64_t offset, uint64_t bytes, void *values,
                     struct kiln_error *error)
{
    char path[KILN_PATH_SIZE];
    int descriptor = -1;
    uint64_t size;
    int status = open_part(c, c->generation, part, path, &descriptor, &size, error);
    if (status == KILN_OK)
        status = read_at(descriptor, path, offset, bytes, values, error);
    if (descriptor >= 0)
        (void)close(descriptor);
    return status;
}

/* Finds the file that contains element `at` of the array, starting with file `from`, since files are in the order of
 * their ranges. NULL: there is none. */
static const struct checkpoint_array *block_with(const struct kiln_checkpoint *c, const char *name, size_t size,
                                                 uint64_t at, size_t from, size_t *part)
{
    for (size_t i = 0; i < c->part_count; i++) {
        *part = (from + i) % c->part_count;
        const struct checkpoint_array *b = find_array(c, *part, name);
        if (b != NULL && b->size == size && at >= b->first && at - b->first < b->count)
            return b;
    }
    return NULL;
}

int kiln_checkpoint_read(const struct kiln_checkpoint *c, const char *name, uint64_t first, uint64_t count, size_t size,
                         void *values, struct kiln_error *error)
{
    size_t part = 0;
    for (uint64_t got = 0; got < count;) { /* each element is read from one file, even if ranges overlap */
        const uint64_t at = first + got;
        const struct checkpoint_array *b = block_with(c, name, size, at, part, &part);
        if (b == NULL)
            return kiln_fail(error, KILN_IO,
                             "the checkpoint %s has %llu of %llu values of '%s' from %llu on; give --no-resume to "
                             "start from the beginning",
                             c->path, (unsigned long long)got, (unsigned long long)count, name,
                             (unsigned long long)first);
        const uint64_t left = b->count - (at - b->first), step = left < count - got ? left : count - got;
        const int status =
            read_from(c, part, b->offset + (at - b->first) * size, step * size, (char *)values + got * size, error);
        if (status != KILN_OK)
            return status;
        got += step;
    }
    return KILN_OK;
}

int kiln_checkpoint_read_file(const struct kiln_checkpoint *c, size_t part, const char *name, size_t size, void *values,
                              uint64_t *count, struct kiln_error *error)
{
    const struct checkpoint_array *b = find_array(c, part, name);
    void *bytes = NULL;
    *count = 0;
    if (b == NULL || b->size != size)
        return kiln_fail(error, KILN_IO,
                         "the checkpoint %s has no '%s' in its file %zu; give --no-resume to start from the beginning",
                         c->path, name, part);
    int status = kiln_allocate(&bytes, (size_t)b->count, size, "a checkpoint's values", error);
    if (status == KILN_OK)
        status = read_from(c, part, b->offset, b->count * size, bytes, error);
    if (status == KILN_OK)
        *count = b->count;
    else
        kiln_free(&bytes);
    memcpy(values, &bytes, sizeof bytes);
    return status;
}

void kiln_checkpoint_remove(struct kiln_checkpoint *c)
{
    uint64_t *generations = NULL;
    size_t count = 0;
    kiln_assert_same(c->communicator, c->newest, "the checkpoint that is removed");
    forget(c);
    if (c->local != NULL)
        checkpoint_local_remove(c);
    (void)MPI_Barrier(c->communicator); /* wait until no rank reads any more */
    if (c->rank != 0)
        return;
    if (survey(c, &generations, &count, NULL) == KILN_OK)
        for (size_t i = 0; i < count; i++)
            checkpoint_remove_generation(c->directory, false, generations[i]);
    kiln_free(&generations);
    (void)kiln_unlink_below(c->directory, CHECKPOINT_KEY_FILE);
    kiln_checkpoint_remove_folder(c->directory);
}
