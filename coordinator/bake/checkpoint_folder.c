#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "coordinator/bake/checkpoint_private.h"
#include "worker/base/calls.h"
#include "worker/base/memory.h"

int checkpoint_generation_path(char path[KILN_PATH_SIZE], const char *folder, bool writing, uint64_t generation, struct kiln_error *error)
{
    char name[48];
    (void)snprintf(name, sizeof name, "%s-%06llu", writing ? ".writing" : "gen", (unsigned long long)generation);
    return kiln_path_join(path, folder, name, error);
}

int checkpoint_part_path(char path[KILN_PATH_SIZE], const char *generation, size_t part, struct kiln_error *error)
{
    char name[32];
    (void)snprintf(name, sizeof name, "part-%05zu", part);
    return kiln_path_join(path, generation, name, error);
}

/* The number in "PREFIX-000012". */
static bool number_of(const char *name, const char *prefix, uint64_t *number)
{
    const size_t length = strlen(prefix);
    char *end = NULL;
    if (strncmp(name, prefix, length) != 0 || name[length] < '0' || name[length] > '9')
        return false;
    errno = 0;
    *number = strtoull(name + length, &end, 10);
    return errno == 0 && *end == '\0' && *number > 0;
}

static int newest_first(const void *a, const void *b)
{
    const uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;
    return (x < y) - (x > y);
}

int checkpoint_list(const char *folder, bool writing, uint64_t **generations, size_t *count, struct kiln_error *error)
{
    size_t room = 0;
    int status = KILN_OK;
    *generations = NULL;
    *count = 0;
    DIR *directory = opendir(folder);
    if (directory == NULL)
        return errno == ENOENT || errno == ENOTDIR ? KILN_OK : kiln_fail_errno(error, 0, "the folder '%s' cannot be read", folder);
    for (const struct dirent *entry; status == KILN_OK && (entry = readdir(directory)) != NULL;) {
        uint64_t number;
        if (!number_of(entry->d_name, writing ? ".writing-" : "gen-", &number))
            continue;
        status = kiln_grow(generations, &room, *count + 1, sizeof **generations, "the generations", error);
        if (status == KILN_OK)
            (*generations)[(*count)++] = number;
    }
    (void)closedir(directory);
    if (*count > 1)
        qsort(*generations, *count, sizeof **generations, newest_first);
    return status;
}

void checkpoint_remove_generation(const char *folder, bool writing, uint64_t generation)
{
    char path[KILN_PATH_SIZE], aside[KILN_PATH_SIZE], file[KILN_PATH_SIZE];
    if (checkpoint_generation_path(path, folder, writing, generation, NULL) != KILN_OK)
        return;
    /* A generation that is half removed must not look like one that was damaged. */
    if (!writing && checkpoint_generation_path(aside, folder, true, generation, NULL) == KILN_OK && kiln_rename(path, aside) == 0)
        memcpy(path, aside, sizeof path);
    DIR *directory = opendir(path);
    if (directory == NULL)
        return;
    for (const struct dirent *entry; (entry = readdir(directory)) != NULL;) {
        const bool ours = strncmp(entry->d_name, "part-", 5) == 0 || strcmp(entry->d_name, "manifest") == 0 ||
                          strcmp(entry->d_name, ".manifest.part") == 0;
        if (ours && kiln_path_join(file, path, entry->d_name, NULL) == KILN_OK)
            (void)kiln_unlink(file);
    }
    (void)closedir(directory);
    (void)rmdir(path);
}

int checkpoint_sync_folder(const char *path, struct kiln_error *error)
{
    const int descriptor = kiln_open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC, 0);
    if (descriptor < 0)
        return kiln_fail_errno(error, KILN_IO, "the folder '%s' cannot be opened to sync it", path);
    const int failed = kiln_fsync(descriptor) != 0 && errno != EINVAL; /* some file systems have nothing to sync for a folder */
    const int status = failed ? kiln_fail_errno(error, KILN_IO, "the folder '%s' cannot be synced to disk", path) : KILN_OK;
    (void)close(descriptor);
    return status;
}

bool kiln_checkpoint_newest(const char *directory, uint64_t *generation)
{
    char folder[KILN_PATH_SIZE];
    uint64_t *generations = NULL;
    size_t count = 0;
    bool found = false;
    if (kiln_path_join(folder, directory, "checkpoint", NULL) == KILN_OK &&
        checkpoint_list(folder, false, &generations, &count, NULL) == KILN_OK && count > 0) {
        *generation = generations[0];
        found = true;
    }
    kiln_free(&generations);
    return found;
}
