#include "coordinator/files/folder.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "coordinator/files/publish.h"
#include "worker/base/calls.h"

enum { NAME_SIZE = 512 };

static int cannot_create(const char *path, struct kiln_error *error)
{
    const int status = errno == EACCES || errno == EPERM ? KILN_PERMISSION : KILN_CANNOT_CREATE;
    return kiln_fail_errno(error, status, "the folder '%s' cannot be created", path);
}

int kiln_path_join(char path[KILN_PATH_SIZE], const char *directory, const char *name, struct kiln_error *error)
{
    const int length = snprintf(path, KILN_PATH_SIZE, "%s/%s", directory, name);
    if (length < 0 || length >= KILN_PATH_SIZE)
        return kiln_fail(error, KILN_CANNOT_CREATE,
                         "the path '%.200s.../%.200s' is longer than %d bytes: choose a shorter folder", directory,
                         name, KILN_PATH_SIZE - 1);
    return KILN_OK;
}

static int make_directory(const char *path, struct kiln_error *error)
{
    if (mkdir(path, 0777) == 0)
        return KILN_OK;
    if (errno == EEXIST) {
        struct stat status;
        if (stat(path, &status) == 0 && S_ISDIR(status.st_mode))
            return KILN_OK;
        errno = ENOTDIR;
    }
    return cannot_create(path, error);
}

int kiln_make_directories(const char *path, struct kiln_error *error)
{
    char above[KILN_PATH_SIZE];
    const int length = snprintf(above, sizeof above, "%s", path);
    if (length < 1 || length >= KILN_PATH_SIZE)
        return kiln_fail(error, KILN_CANNOT_CREATE, "a folder's name has %d bytes: 1 to %d are possible", length,
                         KILN_PATH_SIZE - 1);
    int status = KILN_OK;
    for (char *slash = strchr(above + 1, '/'); slash != NULL && status == KILN_OK; slash = strchr(slash + 1, '/')) {
        *slash = '\0';
        status = make_directory(above, error);
        *slash = '/';
    }
    return status == KILN_OK ? make_directory(path, error) : status;
}

/* ---- path components ---- */

/* Reports what exists under the name instead of the folder or file that was wanted. */
static int refuse(int descriptor, const char *name, const char *path, const char *wanted, struct kiln_error *error)
{
    const int number = errno;
    struct stat found;
    if (fstatat(descriptor, name, &found, AT_SYMLINK_NOFOLLOW) == 0 && S_ISLNK(found.st_mode))
        return kiln_fail(
            error, KILN_CANNOT_CREATE,
            "'%s' is a symbolic link, and none is followed within the folder of a bake: remove it, or name the "
            "folder that is meant with -o",
            path);
    errno = number;
    const int status = number == EACCES || number == EPERM     ? KILN_PERMISSION
                       : number == ENOENT                      ? KILN_NO_INPUT
                       : number == ENOTDIR || number == EEXIST ? KILN_CANNOT_CREATE
                                                               : 0;
    return kiln_fail_errno(error, status, "the %s '%s' cannot be opened", wanted, path);
}

/* Copies the next component of the path *below to `name` and moves *below past it; false at its end. */
static bool next_name(const char **below, char name[NAME_SIZE])
{
    const char *from = *below;
    while (*from == '/' || (*from == '.' && (from[1] == '/' || from[1] == '\0')))
        from++;
    const size_t length = strcspn(from, "/");
    (void)snprintf(name, NAME_SIZE, "%.*s", (int)(length < NAME_SIZE ? length : NAME_SIZE - 1), from);
    *below = from + length;
    return length > 0;
}

/* Replaces an open folder by its subfolder `name`. */
static int enter(struct kiln_folder *folder, const char *name, bool make, struct kiln_error *error)
{
    char path[KILN_PATH_SIZE];
    int status = kiln_path_join(path, folder->path, name, error);
    if (status != KILN_OK)
        return status;
    if (strcmp(name, "..") == 0)
        return kiln_fail(error, KILN_CANNOT_CREATE, "'%s' leads out of the folder", path);
    if (make && mkdirat(folder->descriptor, name, 0777) != 0 && errno != EEXIST)
        return cannot_create(path, error);
    const int next = kiln_openat(folder->descriptor, name, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC, 0);
    if (next < 0)
        return refuse(folder->descriptor, name, path, "folder", error);
    (void)close(folder->descriptor);
    folder->descriptor = next;
    memcpy(folder->path, path, sizeof path);
    return KILN_OK;
}

int kiln_folder_open(struct kiln_folder *folder, const char *directory, const char *below, bool make,
                     struct kiln_error *error)
{
    char name[NAME_SIZE];
    folder->descriptor = -1;
    const int length = snprintf(folder->path, sizeof folder->path, "%s", directory);
    if (length < 1 || length >= KILN_PATH_SIZE)
        return kiln_fail(error, KILN_CANNOT_CREATE, "a folder's name has %d bytes: 1 to %d are possible", length,
                         KILN_PATH_SIZE - 1);
    folder->descriptor = kiln_open(directory, O_RDONLY | O_DIRECTORY | O_CLOEXEC, 0);
    if (folder->descriptor < 0)
        return kiln_fail_errno(error,
                               errno == EACCES || errno == EPERM ? KILN_PERMISSION
                               : errno == ENOENT                 ? KILN_NO_INPUT
                                                                 : KILN_CANNOT_CREATE,
                               "the folder '%s' cannot be opened", directory);
    int status = KILN_OK;
    while (status == KILN_OK && below != NULL && next_name(&below, name))
        status = enter(folder, name, make, error);
    if (status != KILN_OK) {
        const int number = errno;
        kiln_folder_close(folder);
        errno = number;
    }
    return status;
}

void kiln_folder_close(struct kiln_folder *folder)
{
    if (folder->descriptor >= 0)
        (void)close(folder->descriptor);
    folder->descriptor = -1;
}

int kiln_make_parents(const char *directory, const char *name, struct kiln_error *error)
{
    char below[KILN_PATH_SIZE];
    struct kiln_folder folder;
    const char *slash = strrchr(name, '/');
    if (slash == NULL)
        return KILN_OK;
    (void)snprintf(below, sizeof below, "%.*s", (int)(slash - name), name);
    const int status = kiln_folder_open(&folder, directory, below, true, error);
    kiln_folder_close(&folder);
    return status;
}

int kiln_folder_sync(const struct kiln_folder *folder, struct kiln_error *error)
{
    /* some file systems cannot sync a folder and return EINVAL */
    const bool failed = kiln_fsync(folder->descriptor) != 0 && errno != EINVAL;
    return failed ? kiln_fail_errno(error, KILN_IO, "the folder '%s' cannot be synced to disk", folder->path) : KILN_OK;
}

/* ---- files ---- */

/* Opens the folder that contains DIRECTORY/NAME; *base is the last component of NAME. */
static int open_parent(struct kiln_folder *folder, const char *directory, const char *name, const char **base,
                       struct kiln_error *error)
{
    char below[KILN_PATH_SIZE];
    const char *slash = strrchr(name, '/');
    *base = slash == NULL ? name : slash + 1;
    const int length = snprintf(below, sizeof below, "%.*s", slash == NULL ? 0 : (int)(slash - name), name);
    if (length < 0 || length >= KILN_PATH_SIZE) {
        folder->descriptor = -1;
        return kiln_fail(error, KILN_CANNOT_CREATE, "the path '%.200s...' is longer than %d bytes", name,
                         KILN_PATH_SIZE - 1);
    }
    return kiln_folder_open(folder, directory, below, false, error);
}

int kiln_open_below(const char *directory, const char *name, int flags, mode_t mode, int *descriptor,
                    struct kiln_error *error)
{
    struct kiln_folder folder;
    char path[KILN_PATH_SIZE];
    const char *base;
    struct stat found;
    *descriptor = -1;
    int status = kiln_path_join(path, directory, name, error);
    if (status == KILN_OK)
        status = open_parent(&folder, directory, name, &base, error);
    if (status != KILN_OK)
        return status;
    *descriptor = kiln_openat(folder.descriptor, base, flags | O_NOFOLLOW | O_CLOEXEC | O_NONBLOCK, mode);
    if (*descriptor < 0) {
        status = refuse(folder.descriptor, base, path, "file", error);
    } else if (fstat(*descriptor, &found) != 0 || !S_ISREG(found.st_mode)) {
        (void)close(*descriptor);
        *descriptor = -1;
        status = kiln_fail(error, KILN_BAD_INPUT, "'%s' is not a plain file", path);
    }
    kiln_folder_close(&folder);
    return status;
}

static int remove_below(const char *directory, const char *name, int flags)
{
    struct kiln_folder folder;
    const char *base;
    if (open_parent(&folder, directory, name, &base, NULL) != KILN_OK)
        return -1;
    const int result = kiln_unlinkat(folder.descriptor, base, flags);
    const int number = errno;
    kiln_folder_close(&folder);
    errno = number;
    return result;
}

int kiln_unlink_below(const char *directory, const char *name) { return remove_below(directory, name, 0); }

int kiln_rmdir_below(const char *directory, const char *name) { return remove_below(directory, name, AT_REMOVEDIR); }

int kiln_read_file_below(const char *directory, const char *name, size_t limit, char **bytes, size_t *size,
                         struct kiln_error *error)
{
    char path[KILN_PATH_SIZE];
    int descriptor = -1;
    *bytes = NULL;
    *size = 0;
    int status;
    KILN_TRY(kiln_path_join(path, directory, name, error));
    KILN_TRY(kiln_open_below(directory, name, O_RDONLY, 0, &descriptor, error));
    KILN_TRY(kiln_read_descriptor(descriptor, path, limit, bytes, size, error));
end:
    return status;
}

int kiln_check_below(const char *directory, const char *name, bool folder_wanted, struct kiln_error *error)
{
    struct kiln_folder folder;
    char path[KILN_PATH_SIZE];
    const char *base;
    struct stat found;
    int status = kiln_path_join(path, directory, name, error);
    if (status != KILN_OK)
        return status;
    status = open_parent(&folder, directory, name, &base, error);
    if (status == KILN_NO_INPUT)
        return KILN_OK;
    if (status == KILN_OK && fstatat(folder.descriptor, base, &found, AT_SYMLINK_NOFOLLOW) == 0) {
        if (S_ISLNK(found.st_mode))
            status = refuse(folder.descriptor, base, path, "file", error);
        else if (folder_wanted ? !S_ISDIR(found.st_mode) : !S_ISREG(found.st_mode))
            status = kiln_fail(error, KILN_CANNOT_CREATE,
                               "'%s' is in the way: it is no %s; remove it, or choose another folder with -o", path,
                               folder_wanted ? "folder" : "plain file");
    }
    kiln_folder_close(&folder);
    return status;
}
