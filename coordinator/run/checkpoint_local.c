#include "coordinator/run/checkpoint_local.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <semaphore.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "coordinator/mpi/agree.h"
#include "coordinator/run/checkpoint_private.h"
#include "worker/base/calls.h"
#include "worker/base/memory.h"
#include "worker/base/thread.h"

enum { KEY_BYTES = 16, KEY_TEXT = 2 * KEY_BYTES + 1, STEP = 1 << 20, MANIFEST_MOST = 1 << 28, LOOK_MILLISECONDS = 50 };

/* Outcome of the other ranks' copies; rank 0's main thread tells its copying thread. */
enum verdict { UNKNOWN, ALL_COPIED, GIVEN_UP };

struct checkpoint_local {
    char folder[KILN_PATH_SIZE]; /* --checkpoint-local */
    /* the copy under way */
    const struct kiln_checkpoint *c;
    pthread_t thread;
    bool runs;
    uint64_t generation;
    char *manifest; /* rank 0 */
    size_t manifest_size;
    atomic_bool leave;  /* it is to end as soon as it can */
    atomic_int verdict; /* enum verdict */
    sem_t copied;       /* rank 0: its own file is copied, or that failed */
    int status;         /* of the own file, then of the whole */
    struct kiln_error error;
};

/* ---- the key ---- */

static void make_key(char key[KEY_TEXT])
{
    unsigned char bytes[KEY_BYTES] = {0};
    (void)getrandom(bytes, sizeof bytes, 0);
    for (int i = 0; i < KEY_BYTES; i++)
        (void)snprintf(key + 2 * i, 3, "%02x", bytes[i]);
}

/* Reads the bake's key. False: there is no key file, or it has no valid key. */
static bool read_key(const char *directory, char key[KEY_TEXT])
{
    char *text = NULL;
    size_t size = 0;
    const bool there = kiln_read_file_below(directory, CHECKPOINT_KEY_FILE, 4096, &text, &size, NULL) == KILN_OK &&
                       size == KEY_TEXT - 1 && strspn(text, "0123456789abcdef") == KEY_TEXT - 1;
    if (there)
        (void)snprintf(key, KEY_TEXT, "%s", text);
    kiln_free(&text);
    return there;
}

/* Rank 0. Also makes DIR/checkpoint. */
static int read_or_make_key(const char *directory, char key[KEY_TEXT], struct kiln_error *error)
{
    struct kiln_folder folder;
    if (read_key(directory, key))
        return KILN_OK;
    const int status = kiln_folder_open(&folder, directory, "checkpoint", true, error);
    kiln_folder_close(&folder);
    make_key(key);
    return status == KILN_OK ? kiln_publish_bytes_below(directory, CHECKPOINT_KEY_FILE, key, strlen(key), error)
                             : status;
}

static int key_folder(char path[KILN_PATH_SIZE], const char *local, const char key[KEY_TEXT], struct kiln_error *error)
{
    char name[KEY_TEXT + 8];
    (void)snprintf(name, sizeof name, "kiln-%s", key);
    return kiln_path_join(path, local, name, error);
}

static int rank_folder(char path[KILN_PATH_SIZE], const char *local, const char key[KEY_TEXT], uint64_t rank,
                       struct kiln_error *error)
{
    char below[KILN_PATH_SIZE], name[32];
    (void)snprintf(name, sizeof name, "rank-%05llu", (unsigned long long)rank);
    const int status = key_folder(below, local, key, error);
    return status == KILN_OK ? kiln_path_join(path, below, name, error) : status;
}

/* ---- copying files ---- */

static int copy_bytes(int from, int to, const char *path, const atomic_bool *leave, struct kiln_error *error)
{
    void *buffer = NULL;
    int status = kiln_allocate(&buffer, STEP, 1, "copying a checkpoint", error);
    for (uint64_t at = 0; status == KILN_OK;) {
        const ssize_t got = pread(from, buffer, STEP, (off_t)at);
        if (got < 0 && errno == EINTR)
            continue;
        if (got < 0)
            status = kiln_fail_errno(error, KILN_IO, "'%s' cannot be read", path);
        else if (leave != NULL && atomic_load(leave))
            status = KILN_STOPPED;
        if (got <= 0 || status != KILN_OK)
            break;
        status = kiln_write_all(to, buffer, (size_t)got, (size_t)at, path, error);
        at += (uint64_t)got;
    }
    kiln_free(&buffer);
    return status;
}

/* Renames a part to its final name, by which others recognize that it is complete. */
static int rename_part(const char *directory, uint64_t generation, const char *name, struct kiln_error *error)
{
    struct kiln_folder folder;
    const char *base = strrchr(name, '/') + 1;
    char aside[CHECKPOINT_NAME];
    (void)snprintf(aside, sizeof aside, "%s.copy", base);
    int status = checkpoint_open_generation(&folder, directory, true, generation, false, error);
    if (status == KILN_OK && kiln_renameat(folder.descriptor, aside, base) != 0)
        status = kiln_fail_errno(error, KILN_IO, "'%s/%s' cannot be renamed", folder.path, aside);
    kiln_folder_close(&folder);
    return status;
}

/* Copies a part of a complete generation at `place` to the generation being written in `directory`. */
static int copy_part(const char *place, const char *directory, uint64_t generation, size_t part,
                     const atomic_bool *leave, struct kiln_error *error)
{
    char from_name[CHECKPOINT_NAME], name[CHECKPOINT_NAME], aside[CHECKPOINT_NAME + 8], path[KILN_PATH_SIZE];
    int from = -1, to = -1;
    checkpoint_file_name(from_name, false, generation, part);
    checkpoint_file_name(name, true, generation, part);
    (void)snprintf(aside, sizeof aside, "%s.copy", name);
    int status;
    KILN_TRY(kiln_path_join(path, directory, aside, error));
    KILN_TRY(kiln_open_below(place, from_name, O_RDONLY, 0, &from, error));
    KILN_TRY(kiln_open_below(directory, aside, O_WRONLY | O_CREAT | O_TRUNC, 0666, &to, error));
    KILN_TRY(copy_bytes(from, to, path, leave, error));
    if (kiln_fsync(to) != 0)
        KILN_TRY(kiln_fail_errno(error, KILN_IO, "'%s' cannot be synced to disk", path));
end:
    if (from >= 0)
        (void)close(from);
    if (to >= 0 && kiln_close(to) != 0 && status == KILN_OK)
        status = kiln_fail_errno(error, KILN_IO, "'%s' cannot be closed", path);
    return status == KILN_OK ? rename_part(directory, generation, name, error) : status;
}

/* ---- the thread that copies ---- */

/* Rank 0: whether the files of all parts exist. */
static bool all_there(const struct kiln_checkpoint *c, uint64_t generation)
{
    struct kiln_folder folder;
    struct stat found;
    bool all = checkpoint_open_generation(&folder, c->directory, true, generation, false, NULL) == KILN_OK;
    for (size_t i = 0; all && i < (size_t)c->ranks; i++) {
        char name[CHECKPOINT_NAME];
        checkpoint_file_name(name, true, generation, i);
        all = fstatat(folder.descriptor, strrchr(name, '/') + 1, &found, AT_SYMLINK_NOFOLLOW) == 0;
    }
    kiln_folder_close(&folder);
    return all;
}

/* Rank 0, whose own part is copied: waits for the parts of the others, then publishes the generation. */
static void publish_once_whole(struct checkpoint_local *l)
{
    const struct timespec pause = {.tv_nsec = LOOK_MILLISECONDS * 1000000L};
    while (atomic_load(&l->verdict) == UNKNOWN && !all_there(l->c, l->generation))
        (void)nanosleep(&pause, NULL);
    if (atomic_load(&l->verdict) != GIVEN_UP)
        l->status = checkpoint_publish(l->c->directory, l->generation, l->manifest, l->manifest_size, &l->error);
}

static void *run(void *context)
{
    struct checkpoint_local *l = context;
    const struct kiln_checkpoint *c = l->c;
    kiln_thread_give_way();
    l->status = copy_part(c->place, c->directory, l->generation, (size_t)c->rank, &l->leave, &l->error);
    const bool waits = c->rank == 0 && l->status == KILN_OK;
    (void)sem_post(&l->copied);
    if (waits)
        publish_once_whole(l);
    return NULL;
}

/* Ends the thread. `verdict`: tells rank 0's thread the outcome. */
static void join(struct checkpoint_local *l, enum verdict verdict)
{
    atomic_store(&l->verdict, verdict);
    if (l->runs) {
        (void)pthread_join(l->thread, NULL);
        (void)sem_destroy(&l->copied);
    }
    l->runs = false;
    kiln_free(&l->manifest);
}

/* Rank 0, for all. */
static void warn(const struct checkpoint_local *l, const struct kiln_error *error)
{
    (void)fprintf(stderr, "kiln: warning: checkpoint %llu is on the nodes alone, for it could not be copied: %s\n",
                  (unsigned long long)l->generation, error->message);
}

/* Rank 0: finishes after all ranks have copied their parts, or one could not: *status, *error. */
static void finish_copy(struct checkpoint_local *l, int status, struct kiln_error *error)
{
    const struct kiln_checkpoint *c = l->c;
    if (status == KILN_OK && !l->runs) /* else its thread does that */
        l->status = checkpoint_publish(c->directory, l->generation, l->manifest, l->manifest_size, &l->error);
    join(l, status == KILN_OK ? ALL_COPIED : GIVEN_UP);
    if (status == KILN_OK && l->status != KILN_OK)
        *error = l->error;
    if (status == KILN_OK && l->status == KILN_OK)
        return;
    warn(l, error);
    checkpoint_remove_generation(c->directory, true, l->generation);
}

void kiln_checkpoint_settle(struct kiln_checkpoint *c)
{
    struct checkpoint_local *l = c->local;
    struct kiln_error error = {{0}};
    if (l == NULL || l->generation == 0)
        return;
    if (c->rank != 0)
        join(l, UNKNOWN);
    else if (l->runs)
        (void)sem_wait(&l->copied);
    if (l->status != KILN_OK)
        error = l->error;
    const int status = kiln_agree(c->communicator, l->status, &error);
    if (c->rank == 0)
        finish_copy(l, status, &error);
    l->generation = 0;
    (void)MPI_Barrier(c->communicator);
}

void checkpoint_local_copy(struct kiln_checkpoint *c, uint64_t generation, uint64_t bytes, const char *manifest,
                           size_t size)
{
    struct checkpoint_local *l = c->local;
    struct kiln_error error = {{0}};
    l->generation = generation;
    l->status = KILN_OK;
    l->leave = false;
    l->verdict = UNKNOWN;
    int status = c->rank == 0 ? checkpoint_begin(c->directory, false, bytes, generation, &error) : KILN_OK;
    if (status == KILN_OK && c->rank == 0)
        status = kiln_allocate(&l->manifest, size, 1, "a checkpoint's manifest", &error);
    status = kiln_agree(c->communicator, status, &error);
    if (status != KILN_OK) {
        if (c->rank == 0)
            warn(l, &error);
        kiln_free(&l->manifest);
        l->generation = 0;
        return;
    }
    if (c->rank == 0)
        memcpy(l->manifest, manifest, size);
    l->manifest_size = size;
    (void)sem_init(&l->copied, 0, 0);
    l->runs = kiln_thread_start(&l->thread, run, l);
    if (!l->runs)
        l->status = copy_part(c->place, c->directory, generation, (size_t)c->rank, NULL, &l->error);
}

void checkpoint_local_close(struct kiln_checkpoint *c)
{
    struct checkpoint_local *l = c->local;
    l->leave = true;
    join(l, GIVEN_UP);
    kiln_free(&c->local);
}

/* ---- writing ---- */

/* Whether the rank can write to the folder. */
static int check_folder(const char *local, struct kiln_error *error)
{
    struct stat found;
    if (stat(local, &found) != 0)
        return kiln_fail_errno(error, KILN_CANNOT_CREATE,
                               "--checkpoint-local: there is no folder '%s' here; make it on each node", local);
    if (!S_ISDIR(found.st_mode))
        return kiln_fail(error, KILN_CANNOT_CREATE,
                         "--checkpoint-local: '%s' is no folder; name one that is on each node", local);
    if (access(local, R_OK | W_OK | X_OK) != 0)
        return kiln_fail_errno(error, KILN_PERMISSION,
                               "--checkpoint-local: nothing can be written to '%s'; name a folder that is yours on "
                               "each node",
                               local);
    return KILN_OK;
}

int checkpoint_local_begin(struct kiln_checkpoint *c, struct kiln_error *error)
{
    char key[KEY_TEXT] = {0};
    kiln_checkpoint_settle(c);
    int status =
        kiln_agree(c->communicator, c->rank == 0 ? read_or_make_key(c->directory, key, error) : KILN_OK, error);
    if (status != KILN_OK)
        return status;
    (void)MPI_Bcast(key, sizeof key, MPI_CHAR, 0, c->communicator);
    status = rank_folder(c->place, c->local->folder, key, (uint64_t)c->rank, error);
    if (status == KILN_OK)
        status = kiln_make_directories(c->place, error);
    return kiln_agree(c->communicator, status, error);
}

/* ---- what nodes have ---- */

/* Calls `visit` for each rank's folder of this bake on this node, until it returns false. */
typedef bool (*visit_rank)(void *context, const char *place, uint64_t rank);
static void visit_ranks(const char *local, const char key[KEY_TEXT], visit_rank visit, void *context)
{
    char folder[KILN_PATH_SIZE], place[KILN_PATH_SIZE];
    DIR *entries = key_folder(folder, local, key, NULL) == KILN_OK ? opendir(folder) : NULL;
    bool on = entries != NULL;
    for (const struct dirent *entry; on && (entry = readdir(entries)) != NULL;) {
        char *end = NULL;
        const uint64_t rank = strncmp(entry->d_name, "rank-", 5) == 0 ? strtoull(entry->d_name + 5, &end, 10) : 0;
        if (end != NULL && end != entry->d_name + 5 && *end == '\0' &&
            kiln_path_join(place, folder, entry->d_name, NULL) == KILN_OK)
            on = visit(context, place, rank);
    }
    if (entries != NULL)
        (void)closedir(entries);
}

static bool remove_rank(void *context, const char *place, uint64_t rank)
{
    (void)context;
    (void)rank;
    for (int writing = 0; writing < 2; writing++) {
        uint64_t *generations = NULL;
        size_t count = 0;
        (void)checkpoint_list(place, writing != 0, &generations, &count, NULL);
        for (size_t i = 0; i < count; i++)
            checkpoint_remove_generation(place, writing != 0, generations[i]);
        kiln_free(&generations);
    }
    kiln_checkpoint_remove_folder(place);
    (void)rmdir(place);
    return true;
}

/* Collective. Whether this is the first rank of its node. */
static bool leads_node(MPI_Comm communicator)
{
    MPI_Comm node;
    int rank;
    (void)MPI_Comm_split_type(communicator, MPI_COMM_TYPE_SHARED, 0, MPI_INFO_NULL, &node);
    (void)MPI_Comm_rank(node, &rank);
    (void)MPI_Comm_free(&node);
    return rank == 0;
}

/* Collective. Shares the bake's key with all ranks; false: there is none. */
static bool broadcast_key(MPI_Comm communicator, const char *directory, char key[KEY_TEXT])
{
    int rank, there = 0;
    (void)MPI_Comm_rank(communicator, &rank);
    if (rank == 0)
        there = read_key(directory, key);
    (void)MPI_Bcast(&there, 1, MPI_INT, 0, communicator);
    (void)MPI_Bcast(key, KEY_TEXT, MPI_CHAR, 0, communicator);
    return there != 0;
}

void checkpoint_local_remove(struct kiln_checkpoint *c)
{
    struct checkpoint_local *l = c->local;
    char key[KEY_TEXT] = {0}, folder[KILN_PATH_SIZE];
    l->leave = true;
    join(l, GIVEN_UP);
    l->generation = 0;
    (void)MPI_Barrier(c->communicator); /* no rank copies any more */
    const bool there = broadcast_key(c->communicator, c->directory, key), leads = leads_node(c->communicator);
    if (!there || !leads)
        return;
    visit_ranks(l->folder, key, remove_rank, NULL);
    if (key_folder(folder, l->folder, key, NULL) == KILN_OK)
        (void)rmdir(folder);
}

/* visit_rank callback. Removes generations newer than the one that the bake continues from: their numbers will be
 * reused. */
static bool prune_rank(void *context, const char *place, uint64_t rank)
{
    const struct kiln_checkpoint *c = context;
    uint64_t *generations = NULL;
    size_t count = 0;
    (void)rank;
    (void)checkpoint_list(place, false, &generations, &count, NULL);
    for (size_t i = 0; i < count; i++)
        if (generations[i] > c->newest)
            checkpoint_remove_generation(place, false, generations[i]);
    kiln_free(&generations);
    return true;
}

int kiln_checkpoint_write_locally(struct kiln_checkpoint *c, const char *local, struct kiln_error *error)
{
    char key[KEY_TEXT] = {0};
    int status = check_folder(local, error);
    if (status == KILN_OK)
        status = kiln_allocate(&c->local, 1, sizeof *c->local, "checkpoints of the node", error);
    status = kiln_agree(c->communicator, status, error);
    if (c->local != NULL) {
        c->local->c = c;
        (void)snprintf(c->local->folder, sizeof c->local->folder, "%s", local);
    }
    if (status != KILN_OK)
        kiln_free(&c->local);
    if (status == KILN_OK && broadcast_key(c->communicator, c->directory, key) && leads_node(c->communicator))
        visit_ranks(local, key, prune_rank, c);
    return status;
}

/* ---- bringing home ---- */

struct bringing {
    MPI_Comm communicator;
    int rank;
    bool leads;
    const char *directory, *local;
    char key[KEY_TEXT];
    uint64_t above, below; /* generations between these are searched */
    uint64_t newest;       /* of those on this node; 0: none */
    uint64_t generation;   /* that is brought */
    char *manifest;
    size_t manifest_size;
    uint8_t *there; /* of each part */
    size_t part_count;
    int status;
    struct kiln_error *error;
};

/* visit_rank */
static bool find_newest(void *context, const char *place, uint64_t rank)
{
    struct bringing *b = context;
    uint64_t *generations = NULL;
    size_t count = 0;
    (void)rank;
    (void)checkpoint_list(place, false, &generations, &count, NULL);
    for (size_t i = 0; i < count; i++)
        if (generations[i] > b->above && generations[i] < b->below && generations[i] > b->newest)
            b->newest = generations[i];
    kiln_free(&generations);
    return true;
}

/* visit_rank */
static bool read_manifest(void *context, const char *place, uint64_t rank)
{
    struct bringing *b = context;
    char name[CHECKPOINT_NAME];
    (void)rank;
    checkpoint_manifest_name(name, false, b->generation);
    return kiln_read_file_below(place, name, MANIFEST_MOST, &b->manifest, &b->manifest_size, NULL) != KILN_OK;
}

/* visit_rank */
static bool bring_part(void *context, const char *place, uint64_t rank)
{
    struct bringing *b = context;
    char name[CHECKPOINT_NAME];
    int descriptor = -1;
    if (rank >= b->part_count || b->there[rank] != 0)
        return true;
    checkpoint_file_name(name, false, b->generation, (size_t)rank);
    const bool has = kiln_open_below(place, name, O_RDONLY, 0, &descriptor, NULL) == KILN_OK;
    if (!has)
        return true;
    (void)close(descriptor);
    b->status = copy_part(place, b->directory, b->generation, (size_t)rank, NULL, b->error);
    b->there[rank] = b->status == KILN_OK;
    return b->status == KILN_OK;
}

/* Collective: shares the manifest of the lowest rank that has one. False: no rank has one. */
static bool broadcast_manifest(struct bringing *b, struct kiln_error *error)
{
    int ranks, holder;
    (void)MPI_Comm_size(b->communicator, &ranks);
    if (b->leads)
        visit_ranks(b->local, b->key, read_manifest, b);
    holder = b->manifest != NULL ? b->rank : ranks;
    (void)MPI_Allreduce(MPI_IN_PLACE, &holder, 1, MPI_INT, MPI_MIN, b->communicator);
    if (holder == ranks)
        return false;
    uint64_t size = b->manifest_size;
    (void)MPI_Bcast(&size, 1, MPI_UINT64_T, holder, b->communicator);
    int status = KILN_OK;
    if (b->rank != holder) {
        kiln_free(&b->manifest);
        status = kiln_allocate(&b->manifest, (size_t)size + 1, 1, "a checkpoint's manifest", error);
    }
    if (kiln_agree(b->communicator, status, error) != KILN_OK)
        return false;
    (void)MPI_Bcast(b->manifest, (int)size, MPI_BYTE, holder, b->communicator);
    b->manifest_size = (size_t)size;
    json_t *json;
    (void)kiln_unseal(&json, b->manifest, b->manifest_size, b->local, NULL);
    b->part_count = json_array_size(json_object_get(json, "parts"));
    json_decref(json);
    return b->part_count > 0;
}

/* Begins a generation with the bytes of this node's parts. Those of other nodes are unknown yet, so free space is
 * checked part by part. */
static int begin_generation(const struct bringing *b)
{
    return b->rank == 0 ? checkpoint_begin(b->directory, false, 0, b->generation, b->error) : KILN_OK;
}

/* Collective: copies one generation to the bake's folder. *whole: all of its parts were found. */
static int bring(struct bringing *b, bool *whole)
{
    *whole = broadcast_manifest(b, b->error);
    int status = KILN_OK;
    if (*whole)
        status = kiln_allocate(&b->there, b->part_count, 1, "parts of a checkpoint", b->error);
    if (*whole)
        status = kiln_agree(b->communicator, status == KILN_OK ? begin_generation(b) : status, b->error);
    if (!*whole || status != KILN_OK)
        return status;
    b->status = KILN_OK;
    if (b->leads)
        visit_ranks(b->local, b->key, bring_part, b);
    status = kiln_agree(b->communicator, b->status, b->error);
    (void)MPI_Allreduce(MPI_IN_PLACE, b->there, (int)b->part_count, MPI_UINT8_T, MPI_MAX, b->communicator);
    *whole = status == KILN_OK && memchr(b->there, 0, b->part_count) == NULL;
    if (*whole && b->rank == 0)
        status = checkpoint_publish(b->directory, b->generation, b->manifest, b->manifest_size, b->error);
    else if (b->rank == 0)
        checkpoint_remove_generation(b->directory, true, b->generation);
    return kiln_agree(b->communicator, status, b->error);
}

/* Collective: the newest generation on any node that has not been tried yet; 0: none. */
static uint64_t newest_of_all(struct bringing *b)
{
    b->newest = 0;
    if (b->leads)
        visit_ranks(b->local, b->key, find_newest, b);
    (void)MPI_Allreduce(MPI_IN_PLACE, &b->newest, 1, MPI_UINT64_T, MPI_MAX, b->communicator);
    return b->newest;
}

int kiln_checkpoint_bring_home(MPI_Comm communicator, const char *directory, const char *local,
                               struct kiln_error *error)
{
    struct bringing b = {
        .communicator = communicator, .directory = directory, .local = local, .below = UINT64_MAX, .error = error};
    bool whole = false;
    int status = KILN_OK;
    (void)MPI_Comm_rank(communicator, &b.rank);
    if (!broadcast_key(communicator, directory, b.key))
        return KILN_OK;
    b.leads = leads_node(communicator);
    if (b.rank == 0)
        (void)kiln_checkpoint_newest(directory, &b.above);
    (void)MPI_Bcast(&b.above, 1, MPI_UINT64_T, 0, communicator);
    while (status == KILN_OK && !whole && (b.generation = newest_of_all(&b)) > 0) {
        status = bring(&b, &whole);
        b.below = b.generation;
        kiln_free(&b.manifest);
        kiln_free(&b.there);
        b.manifest_size = 0;
    }
    if (whole && status == KILN_OK && b.rank == 0)
        (void)fprintf(stderr, "kiln: note: checkpoint %llu is copied from the nodes that wrote it (%s)\n",
                      (unsigned long long)b.generation, local);
    return status;
}
