#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "coordinator/run/checkpoint_private.h"
#include "worker/base/calls.h"
#include "worker/base/memory.h"

#define FOLDER "checkpoint"

enum { FOLDER_NAME = 40 }; /* size of the name of a generation's folder */

static void name_of(char name[FOLDER_NAME], bool writing, uint64_t generation)
{
    (void)snprintf(name, FOLDER_NAME, "%s-%06llu", writing ? ".writing" : "gen", (unsigned long long)generation);
}

int checkpoint_open_generation(struct kiln_folder *folder, const char *directory, bool writing, uint64_t generation,
                               bool make, struct kiln_error *error)
{
    char name[FOLDER_NAME], below[CHECKPOINT_NAME];
    name_of(name, writing, generation);
    (void)snprintf(below, sizeof below, FOLDER "/%s", name);
    return kiln_folder_open(folder, directory, below, make, error);
}

void checkpoint_file_name(char name[CHECKPOINT_NAME], bool writing, uint64_t generation, size_t part)
{
    char folder[FOLDER_NAME];
    name_of(folder, writing, generation);
    (void)snprintf(name, CHECKPOINT_NAME, FOLDER "/%s/part-%05zu", folder, part);
}

void checkpoint_manifest_name(char name[CHECKPOINT_NAME], bool writing, uint64_t generation)
{
    char folder[FOLDER_NAME];
    name_of(folder, writing, generation);
    (void)snprintf(name, CHECKPOINT_NAME, FOLDER "/%s/manifest", folder);
}

/* Parses the number in "PREFIX-000012". */
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

/* Opens the entries of an open folder; close with closedir. */
static DIR *entries_of(int descriptor)
{
    const int copy = kiln_openat(descriptor, ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC, 0);
    DIR *entries = copy < 0 ? NULL : fdopendir(copy);
    if (entries == NULL && copy >= 0)
        (void)close(copy);
    return entries;
}

static int list_open(const struct kiln_folder *folder, bool writing, uint64_t **generations, size_t *count,
                     struct kiln_error *error)
{
    size_t room = 0;
    int status = KILN_OK;
    DIR *entries = entries_of(folder->descriptor);
    if (entries == NULL)
        return kiln_fail_errno(error, 0, "the folder '%s' cannot be read", folder->path);
    for (const struct dirent *entry; status == KILN_OK && (entry = readdir(entries)) != NULL;) {
        uint64_t number;
        if (!number_of(entry->d_name, writing ? ".writing-" : "gen-", &number))
            continue;
        status = kiln_grow(generations, &room, *count + 1, sizeof **generations, "the generations", error);
        if (status == KILN_OK)
            (*generations)[(*count)++] = number;
    }
    (void)closedir(entries);
    if (*count > 1)
        qsort(*generations, *count, sizeof **generations, newest_first);
    return status;
}

int checkpoint_list(const char *directory, bool writing, uint64_t **generations, size_t *count,
                    struct kiln_error *error)
{
    struct kiln_folder folder;
    *generations = NULL;
    *count = 0;
    int status = kiln_folder_open(&folder, directory, FOLDER, false, error);
    if (status == KILN_NO_INPUT)
        return KILN_OK;
    if (status == KILN_OK)
        status = list_open(&folder, writing, generations, count, error);
    kiln_folder_close(&folder);
    return status;
}

static void empty_generation(int generation)
{
    DIR *entries = entries_of(generation);
    if (entries == NULL)
        return;
    for (const struct dirent *entry; (entry = readdir(entries)) != NULL;) {
        const bool ours = strncmp(entry->d_name, "part-", 5) == 0 || strcmp(entry->d_name, "manifest") == 0 ||
                          strcmp(entry->d_name, ".manifest.part") == 0;
        if (ours)
            (void)kiln_unlinkat(generation, entry->d_name, 0);
    }
    (void)closedir(entries);
}

void checkpoint_remove_generation(const char *directory, bool writing, uint64_t generation)
{
    struct kiln_folder folder;
    char name[FOLDER_NAME], aside[FOLDER_NAME];
    if (kiln_folder_open(&folder, directory, FOLDER, false, NULL) != KILN_OK)
        return;
    name_of(name, writing, generation);
    name_of(aside, true, generation);
    /* rename it first, so that a partly removed generation does not look like a damaged one */
    if (!writing && kiln_renameat(folder.descriptor, name, aside) == 0)
        memcpy(name, aside, sizeof name);
    const int inside = kiln_openat(folder.descriptor, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC, 0);
    if (inside >= 0) {
        empty_generation(inside);
        (void)close(inside);
        (void)kiln_unlinkat(folder.descriptor, name, AT_REMOVEDIR);
    } else if (errno == ELOOP || errno == ENOTDIR) {
        (void)kiln_unlinkat(folder.descriptor, name, 0); /* a link or file under that name; only that is removed */
    }
    kiln_folder_close(&folder);
}

int checkpoint_publish_generation(const char *directory, uint64_t generation, struct kiln_error *error)
{
    struct kiln_folder folder;
    char from[FOLDER_NAME], to[FOLDER_NAME];
    name_of(from, true, generation);
    name_of(to, false, generation);
    int status;
    KILN_TRY(kiln_folder_open(&folder, directory, FOLDER, false, error));
    if (kiln_renameat(folder.descriptor, from, to) != 0)
        KILN_TRY(kiln_fail_errno(error, KILN_IO, "'%s/%s' cannot be renamed to '%s'", folder.path, from, to));
    KILN_TRY(kiln_folder_sync(&folder, error));
end:
    kiln_folder_close(&folder);
    return status;
}

void kiln_checkpoint_remove_folder(const char *directory)
{
    struct kiln_folder folder;
    if (kiln_folder_open(&folder, directory, NULL, false, NULL) == KILN_OK)
        (void)kiln_unlinkat(folder.descriptor, FOLDER, AT_REMOVEDIR); /* fails if it is not empty, which is intended */
    kiln_folder_close(&folder);
}

bool kiln_checkpoint_newest(const char *directory, uint64_t *generation)
{
    uint64_t *generations = NULL;
    size_t count = 0;
    const bool found = checkpoint_list(directory, false, &generations, &count, NULL) == KILN_OK && count > 0;
    if (found)
        *generation = generations[0];
    kiln_free(&generations);
    return found;
}
