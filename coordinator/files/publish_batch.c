#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "coordinator/files/publish.h"
#include "worker/base/calls.h"
#include "worker/base/memory.h"

struct waiting {
    char *base; /* final name; NULL once the file has been renamed to it */
    size_t folder;
    struct kiln_left *left;
};

struct kiln_publish_batch {
    pthread_mutex_t changing;
    struct kiln_folder *folders; /* each folder once */
    size_t folder_count, folder_capacity;
    struct waiting *files;
    size_t count, capacity;
};

/* SYNCING: threads that sync at the same time. They wait for the disk, so there may be more of them than processors.
 * FOLDERS_MOST: folders of a batch, each of which is open; files in further ones are published one by one */
enum { SYNCING = 8, ASIDE_SIZE = 528, FOLDERS_MOST = 256 };

int kiln_publish_batch_create(struct kiln_publish_batch **batch, struct kiln_error *error)
{
    const int status = kiln_allocate(batch, 1, sizeof **batch, "files to publish", error);
    if (status == KILN_OK)
        (void)pthread_mutex_init(&(*batch)->changing, NULL);
    return status;
}

static void name_aside(const struct waiting *file, char aside[ASIDE_SIZE])
{
    (void)snprintf(aside, ASIDE_SIZE, ".%s.part", file->base);
}

/* Whether the batch has the folder, or may open one more. */
static bool has_room(const struct kiln_publish_batch *b, const struct kiln_folder *folder)
{
    for (size_t i = 0; i < b->folder_count; i++)
        if (strcmp(b->folders[i].path, folder->path) == 0)
            return true;
    return b->folder_count < FOLDERS_MOST;
}

static int find_folder(struct kiln_publish_batch *b, struct kiln_folder *folder, size_t *index,
                       struct kiln_error *error)
{
    for (*index = 0; *index < b->folder_count; (*index)++)
        if (strcmp(b->folders[*index].path, folder->path) == 0)
            return KILN_OK;
    const int status =
        kiln_grow(&b->folders, &b->folder_capacity, b->folder_count + 1, sizeof *b->folders, "folders", error);
    if (status != KILN_OK)
        return status;
    b->folders[b->folder_count++] = *folder;
    folder->descriptor = -1; /* the batch has it now */
    return KILN_OK;
}

static int add(struct kiln_publish_batch *b, struct kiln_publish *p, struct kiln_error *error)
{
    struct waiting file = {0};
    const size_t size = strlen(p->base) + 1;
    int status;
    KILN_TRY(kiln_grow(&b->files, &b->capacity, b->count + 1, sizeof *b->files, "files to publish", error));
    KILN_TRY(kiln_allocate(&file.base, size, 1, "a file's name", error));
    KILN_TRY(find_folder(b, &p->folder, &file.folder, error));
end:
    if (status != KILN_OK) {
        kiln_free(&file.base);
        return status;
    }
    memcpy(file.base, p->base, size);
    file.left = kiln_left_note(b->folders[file.folder].descriptor, p->aside);
    b->files[b->count++] = file;
    return KILN_OK;
}

/* Asks the file system to start writing the file, without waiting. This only saves time: kiln_publish_batch_finish
 * syncs each file. */
static void start_writing(const struct kiln_publish *p)
{
    const int descriptor = kiln_openat(p->folder.descriptor, p->aside, O_RDONLY | O_NOFOLLOW | O_CLOEXEC, 0);
    if (descriptor < 0)
        return;
    (void)sync_file_range(descriptor, 0, 0, SYNC_FILE_RANGE_WRITE);
    (void)close(descriptor);
}

int kiln_publish_put(struct kiln_publish_batch *b, struct kiln_publish *p, struct kiln_error *error)
{
    if (p->stream >= 0)
        return kiln_publish_finish(p, error);
    start_writing(p);
    (void)pthread_mutex_lock(&b->changing);
    const bool alone = !has_room(b, &p->folder);
    const int status = alone ? KILN_OK : add(b, p, error);
    (void)pthread_mutex_unlock(&b->changing);
    if (alone)
        return kiln_publish_finish(p, error);
    if (status == KILN_OK)
        kiln_publish_close(p);
    else
        kiln_publish_abandon(p);
    return status;
}

/* ---- end ---- */

static int sync_file(const struct kiln_publish_batch *b, const struct waiting *file, struct kiln_error *error)
{
    char aside[ASIDE_SIZE];
    const struct kiln_folder *folder = &b->folders[file->folder];
    name_aside(file, aside);
    const int descriptor = kiln_openat(folder->descriptor, aside, O_RDONLY | O_NOFOLLOW | O_CLOEXEC, 0);
    if (descriptor < 0)
        return kiln_fail_errno(error, KILN_IO, "'%s/%s' cannot be opened to sync it", folder->path, aside);
    int status = KILN_OK;
    if (kiln_fsync(descriptor) != 0)
        status = kiln_fail_errno(error, KILN_IO, "'%s/%s' cannot be synced to disk", folder->path, aside);
    if (kiln_close(descriptor) != 0 && status == KILN_OK)
        status = kiln_fail_errno(error, KILN_IO, "'%s/%s' cannot be closed", folder->path, aside);
    return status;
}

/* Syncs all files. If several fail, the error of the first one in the list is kept. */
static int sync_files(const struct kiln_publish_batch *b, struct kiln_error *error)
{
    size_t first_failed = SIZE_MAX;
    int status = KILN_OK;
    const int threads = b->count < SYNCING ? (int)b->count : SYNCING;
#pragma omp parallel for schedule(dynamic, 1) num_threads(threads) if (threads > 1)
    for (size_t i = 0; i < b->count; i++) {
        struct kiln_error mine = {{0}};
        const int result = sync_file(b, &b->files[i], &mine);
        if (result == KILN_OK)
            continue;
#pragma omp critical(kiln_publish_batch)
        if (i < first_failed) {
            first_failed = i;
            status = kiln_fail(error, result, "%s", mine.message);
        }
    }
    return status;
}

static int rename_file(const struct kiln_publish_batch *b, struct waiting *file, struct kiln_error *error)
{
    char aside[ASIDE_SIZE];
    const struct kiln_folder *folder = &b->folders[file->folder];
    name_aside(file, aside);
    if (kiln_renameat(folder->descriptor, aside, file->base) != 0)
        return kiln_fail_errno(error, KILN_CANNOT_CREATE, "'%s/%s' cannot be renamed to '%s'", folder->path, aside,
                               file->base);
    kiln_left_forget(&file->left);
    kiln_free(&file->base);
    return KILN_OK;
}

/* Empties the batch; removes the temporary files that remain. */
static void empty(struct kiln_publish_batch *b)
{
    char aside[ASIDE_SIZE];
    for (size_t i = 0; i < b->count; i++) {
        if (b->files[i].base == NULL)
            continue;
        name_aside(&b->files[i], aside);
        (void)kiln_unlinkat(b->folders[b->files[i].folder].descriptor, aside, 0);
        kiln_left_forget(&b->files[i].left);
        kiln_free(&b->files[i].base);
    }
    for (size_t i = 0; i < b->folder_count; i++)
        kiln_folder_close(&b->folders[i]);
    b->count = b->folder_count = 0;
}

int kiln_publish_batch_finish(struct kiln_publish_batch *b, struct kiln_error *error)
{
    int status;
    KILN_TRY(sync_files(b, error));
    for (size_t i = 0; i < b->count; i++)
        KILN_TRY(rename_file(b, &b->files[i], error));
    for (size_t i = 0; i < b->folder_count; i++)
        KILN_TRY(kiln_folder_sync(&b->folders[i], error));
end:
    empty(b);
    return status;
}

void kiln_publish_batch_destroy(struct kiln_publish_batch **batch)
{
    struct kiln_publish_batch *b = *batch;
    if (b == NULL)
        return;
    empty(b);
    kiln_free(&b->folders);
    kiln_free(&b->files);
    (void)pthread_mutex_destroy(&b->changing);
    kiln_free(batch);
}
