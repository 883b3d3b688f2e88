#include "coordinator/files/output_name.h"

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "coordinator/files/publish.h"

/* File names that every bake uses. */
static const char *const own_files[] = {"kiln.h5",      "volume.hdf", "run.json",    "manifest",
                                        "scene.kscene", "scene.glb",  "preview.png", ".kiln.lock"};
static const char *const own_folders[] = {"lightmaps", "checkpoint"};

static bool same_file(const char *a, const char *b)
{
    struct stat one, other;
    return a != NULL && b != NULL && stat(a, &one) == 0 && stat(b, &other) == 0 && S_ISREG(one.st_mode) &&
           one.st_dev == other.st_dev && one.st_ino == other.st_ino;
}

static bool ends_with(const char *text, const char *ending)
{
    const size_t length = strlen(text), tail = strlen(ending);
    return length >= tail && strcmp(text + length - tail, ending) == 0;
}

/* Whether `base`, a name in the folder of a bake, is one of these files, or the temporary name of one. */
static bool is_own_name(const char *base)
{
    for (size_t i = 0; i < sizeof own_files / sizeof *own_files; i++)
        if (strcmp(base, own_files[i]) == 0)
            return true;
    for (size_t i = 0; i < sizeof own_folders / sizeof *own_folders; i++)
        if (strcmp(base, own_folders[i]) == 0)
            return true;
    return base[0] == '.' && (ends_with(base, ".part") || strncmp(base, ".kiln.lock", 10) == 0);
}

/* The part of `path` after `folder`, such as "/lightmaps", or "" if they are equal; NULL if `path` is not in `folder`.
 * Both paths have no links. */
static const char *below(const char *folder, const char *path)
{
    const size_t length = strcmp(folder, "/") == 0 ? 0 : strlen(folder);
    return strncmp(path, folder, length) == 0 && (path[length] == '\0' || path[length] == '/') ? path + length : NULL;
}

/* Whether `path` is a file of the bake in the folder `bake`, by its path or as another name (hard link) of such a file.
 */
static bool is_of_bake(const char *path, const char *bake)
{
    char folder[KILN_PATH_SIZE], own[KILN_PATH_SIZE];
    const char *slash = strrchr(path, '/'), *base = slash == NULL ? path : slash + 1;
    bool found = false;
    (void)snprintf(folder, sizeof folder, "%.*s",
                   slash == NULL   ? 1
                   : slash == path ? 1
                                   : (int)(slash - path),
                   slash == NULL ? "." : path);
    char *real_folder = realpath(folder, NULL), *real_bake = realpath(bake, NULL);
    const char *rest = real_folder != NULL && real_bake != NULL ? below(real_bake, real_folder) : NULL;
    if (rest != NULL && rest[0] == '\0')
        found = is_own_name(base);
    for (size_t i = 0; rest != NULL && rest[0] == '/' && i < sizeof own_folders / sizeof *own_folders; i++)
        found = found || below(own_folders[i], rest + 1) != NULL;
    for (size_t i = 0; i < sizeof own_files / sizeof *own_files && !found; i++)
        found = kiln_path_join(own, bake, own_files[i], NULL) == KILN_OK && same_file(path, own);
    free(real_folder);
    free(real_bake);
    return found;
}

int kiln_output_name_check(const struct kiln_output_name *name, struct kiln_error *error)
{
    for (size_t i = 0; i < sizeof name->inputs / sizeof *name->inputs; i++)
        if (same_file(name->path, name->inputs[i]))
            return kiln_fail(error, KILN_USAGE, "%s %.500s: that is %.500s, which is read; choose another name",
                             name->option, name->path, name->inputs[i]);
    for (size_t i = 0; i < sizeof name->bakes / sizeof *name->bakes; i++)
        if (name->bakes[i] != NULL && is_of_bake(name->path, name->bakes[i]))
            return kiln_fail(error, KILN_USAGE,
                             "%s %.500s: a file of the bake in %.500s itself would be replaced; choose another name",
                             name->option, name->path, name->bakes[i]);
    return kiln_publish_check(NULL, name->path, error);
}
