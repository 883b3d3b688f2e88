#include "coordinator/cli/same_job.h"

#include <limits.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <xxhash.h>

#include "coordinator/files/plain_file.h"
#include "coordinator/mpi/agree.h"
#include "coordinator/job/options.h"
#include "worker/base/memory.h"

enum {
    SAMPLES = 64,
    SAMPLE_BYTES = 1 << 16
}; /* samples of a file and bytes of a sample; a file of up to 4 MiB is read completely */

static const char *const own_matters[] = {"threads", "device", "device-memory", "kernel-cache", "verbose"};

/* A list of names and values in turn, each ending with a zero byte. */
struct list {
    char *text;
    size_t size, room;
    int status;
    struct kiln_error *error;
};

static void add_text(struct list *list, const char *text)
{
    const size_t length = strlen(text) + 1;
    if (list->status == KILN_OK)
        list->status = kiln_grow(&list->text, &list->room, list->size + length, 1, "the job of all ranks", list->error);
    if (list->status != KILN_OK)
        return;
    memcpy(list->text + list->size, text, length);
    list->size += length;
}

static void add(struct list *list, const char *name, const char *value)
{
    add_text(list, name);
    add_text(list, value);
}

/* ---- files ---- */

/* Hashes samples that lie at even distances in the file. */
static bool hash_samples(int descriptor, uint64_t size, char *bytes, uint64_t *hash)
{
    const uint64_t rest = size > SAMPLE_BYTES ? size - SAMPLE_BYTES : 0;
    *hash = 0;
    for (uint64_t i = 0; i < SAMPLES; i++) {
        const ssize_t got = pread(descriptor, bytes, SAMPLE_BYTES,
                                  (off_t)(rest / (SAMPLES - 1) * i + rest % (SAMPLES - 1) * i / (SAMPLES - 1)));
        if (got < 0)
            return false;
        *hash = XXH3_64bits_withSeed(bytes, (size_t)got, *hash);
    }
    return true;
}

/* Formats the size of a file and the hash of its samples. */
static void describe_file(struct list *list, const char *path, char *text, size_t size)
{
    char *bytes = NULL;
    struct stat file;
    uint64_t hash = 0;
    text[0] = '\0';
    if (list->status == KILN_OK)
        list->status = kiln_allocate(&bytes, SAMPLE_BYTES, 1, "a sample of a file", list->error);
    if (list->status != KILN_OK)
        return;
    int descriptor;
    list->status = kiln_open_plain(path, &descriptor, list->error);
    if (list->status == KILN_OK &&
        (fstat(descriptor, &file) != 0 || !hash_samples(descriptor, (uint64_t)file.st_size, bytes, &hash)))
        list->status = kiln_fail_errno(list->error, 0, "cannot read %.500s", path);
    else if (list->status == KILN_OK)
        (void)snprintf(text, size, "%lld bytes, %016llx", (long long)file.st_size, (unsigned long long)hash);
    if (descriptor >= 0)
        (void)close(descriptor);
    kiln_free(&bytes);
}

static void add_scene(struct list *list, const char *path)
{
    char text[64], value[400];
    const char *slash = strrchr(path, '/');
    describe_file(list, path, text, sizeof text);
    (void)snprintf(value, sizeof value, "%.300s (%s)", slash != NULL ? slash + 1 : path, text);
    add(list, "the scene", value);
}

/* Only sizes: a bake of thousands of parts would read samples of all of them on each rank, and each is read by one. */
static void add_part(struct list *list, const struct kiln_part *part)
{
    char name[KILN_PART_NAME + 16], value[64];
    struct stat file = {0};
    (void)snprintf(name, sizeof name, "the part %s", part->name);
    (void)snprintf(value, sizeof value, "%lld bytes", stat(part->file, &file) == 0 ? (long long)file.st_size : -1LL);
    add(list, name, value);
}

/* ---- the list ---- */

static bool is_own_matter(const char *name)
{
    for (size_t i = 0; i < sizeof own_matters / sizeof *own_matters; i++)
        if (strcmp(name, own_matters[i]) == 0)
            return true;
    return false;
}

/* The scene comes first, since defaults of other options may depend on it. */
static void add_job(struct list *list, const struct kiln_job *job)
{
    const struct kiln_command *command = kiln_command_find(job->command);
    if (job->scene.file != NULL)
        add_scene(list, job->scene.file);
    for (size_t i = 0; i < job->scene.part_count; i++)
        add_part(list, &job->scene.parts[i]);
    for (size_t i = command->scene ? 1 : 0; i < job->argument_count; i++)
        if (job->arguments[i] != job->scene.file)
            add(list, "the argument", job->arguments[i]);
    for (size_t i = 0; i < kiln_option_count; i++) {
        const struct kiln_option *option = &kiln_options[i];
        char name[80], room[KILN_OPTION_TEXT];
        if ((option->commands & command->bit) == 0 || is_own_matter(option->name))
            continue;
        (void)snprintf(name, sizeof name, "--%s", option->name);
        add(list, name, kiln_option_text(job, option, room));
    }
    char limit[24];
    (void)snprintf(limit, sizeof limit, "%llu", (unsigned long long)job->faults.exchange_limit);
    add(list, "KILN_EXCHANGE_LIMIT", limit);
}

static void add_build(struct list *list)
{
    char library[MPI_MAX_LIBRARY_VERSION_STRING] = "", text[64];
    int length;
    describe_file(list, "/proc/self/exe", text, sizeof text);
    add(list, "kiln", KILN_VERSION);
    add(list, "the build of kiln", text);
    if (MPI_Get_library_version(library, &length) == MPI_SUCCESS)
        add(list, "the MPI library", library);
}

/* ---- comparing ---- */

static const char *next(const char *at, const char *end)
{
    const char *after = at < end ? at + strlen(at) + 1 : end;
    return after < end ? after : NULL;
}

/* Reports the first entry that differs from rank 0's. Both lists have the same order. */
static int compare(const struct list *own, const char *first, size_t first_size, struct kiln_error *error)
{
    const char *a = own->text, *b = first, *a_end = own->text + own->size, *b_end = first + first_size;
    char host[64] = "";
    int rank = 0;
    (void)MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    (void)gethostname(host, sizeof host - 1);
    while (a != NULL && b != NULL) {
        const char *own_value = next(a, a_end), *value = next(b, b_end);
        const bool same = strcmp(a, b) == 0;
        if (own_value == NULL || value == NULL)
            break;
        if (same && strcmp(own_value, value) != 0)
            return kiln_fail(error, KILN_USAGE,
                             "rank %d on %s has another %s than rank 0: '%.500s', and rank 0 '%.500s'; give all ranks "
                             "the same command, "
                             "files and program",
                             rank, host, strncmp(a, "the ", 4) == 0 ? a + 4 : a, own_value, value);
        if (!same)
            return kiln_fail(error, KILN_USAGE,
                             "rank %d on %s has %s '%.500s' where rank 0 has %s '%.500s'; give all ranks the same "
                             "command, files and "
                             "program",
                             rank, host, a, own_value, b, value);
        a = next(own_value, a_end);
        b = next(value, b_end);
    }
    if (a == NULL && b == NULL)
        return KILN_OK;
    return kiln_fail(error, KILN_USAGE,
                     "rank %d on %s was given %s arguments than rank 0; give all ranks the same command", rank, host,
                     a != NULL ? "more" : "fewer");
}

/* Collective. Broadcasts the list of rank 0. */
static int learn_first(MPI_Comm communicator, const struct list *own, char **first, uint64_t *size,
                       struct kiln_error *error)
{
    int rank;
    (void)MPI_Comm_rank(communicator, &rank);
    *size = own->size;
    (void)MPI_Bcast(size, 1, MPI_UINT64_T, 0, communicator);
    int status = *size <= INT_MAX
                     ? kiln_allocate(first, (size_t)*size, 1, "the job of rank 0", error)
                     : kiln_fail(error, KILN_USAGE, "the job is %llu bytes long", (unsigned long long)*size);
    status = kiln_agree(communicator, status, error);
    if (status != KILN_OK)
        return status;
    if (rank == 0)
        memcpy(*first, own->text, own->size);
    (void)MPI_Bcast(*first, (int)*size, MPI_BYTE, 0, communicator);
    return KILN_OK;
}

int kiln_same_job(MPI_Comm communicator, const char *command, const struct kiln_job *job, struct kiln_error *error)
{
    struct list own = {.error = error};
    char *first = NULL;
    uint64_t size = 0;
    int ranks = 0;
    if (MPI_Comm_size(communicator, &ranks) == MPI_SUCCESS && ranks == 1)
        return KILN_OK; /* reading samples of all files takes longer than a small bake */
    add(&own, "the command", command);
    add_build(&own);
    if (job != NULL)
        add_job(&own, job);
    int status;
    KILN_TRY(kiln_agree(communicator, own.status, error));
    KILN_TRY(learn_first(communicator, &own, &first, &size, error));
    KILN_TRY(kiln_agree(communicator, compare(&own, first, (size_t)size, error), error));
end:
    kiln_free(&own.text);
    kiln_free(&first);
    return status;
}
