#include "coordinator/output/publish.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include "worker/base/calls.h"
#include "worker/base/memory.h"

static int cannot_create(const char *what, const char *path, struct kiln_error *error)
{
    const int status = errno == EACCES || errno == EPERM ? KILN_PERMISSION : KILN_CANNOT_CREATE;
    return kiln_fail_errno(error, status, "%s '%s' cannot be created", what, path);
}

int kiln_path_join(char path[KILN_PATH_SIZE], const char *directory, const char *name, struct kiln_error *error)
{
    const int length = snprintf(path, KILN_PATH_SIZE, "%s/%s", directory, name);
    if (length < 0 || length >= KILN_PATH_SIZE)
        return kiln_fail(error, KILN_CANNOT_CREATE, "the path '%.200s.../%.200s' is longer than %d bytes: choose a shorter folder",
                         directory, name, KILN_PATH_SIZE - 1);
    return KILN_OK;
}

int kiln_make_directory(const char *path, struct kiln_error *error)
{
    if (mkdir(path, 0777) == 0)
        return KILN_OK;
    if (errno == EEXIST) {
        struct stat status;
        if (stat(path, &status) == 0 && S_ISDIR(status.st_mode))
            return KILN_OK;
        errno = ENOTDIR;
    }
    return cannot_create("the folder", path, error);
}

int kiln_make_directories(const char *path, struct kiln_error *error)
{
    char above[KILN_PATH_SIZE];
    const int length = snprintf(above, sizeof above, "%s", path);
    if (length < 1 || length >= KILN_PATH_SIZE)
        return kiln_fail(error, KILN_CANNOT_CREATE, "a folder's name has %d bytes: 1 to %d are possible", length, KILN_PATH_SIZE - 1);
    int status = KILN_OK;
    for (char *slash = strchr(above + 1, '/'); slash != NULL && status == KILN_OK; slash = strchr(slash + 1, '/')) {
        *slash = '\0';
        status = kiln_make_directory(above, error);
        *slash = '/';
    }
    return status == KILN_OK ? kiln_make_directory(path, error) : status;
}

int kiln_require_space(const char *path, uint64_t bytes, struct kiln_error *error)
{
    struct statvfs found;
    if (statvfs(path, &found) != 0)
        return kiln_fail_errno(error, KILN_IO, "the free space of '%s' cannot be found out", path);
    const double free_bytes = (double)found.f_bavail * (double)found.f_frsize, needed = 1.1 * (double)bytes;
    if (needed > free_bytes)
        return kiln_fail(error, KILN_IO, "the disk of '%s' has %.3f MB left and up to %.3f MB are to be written: make room or choose another folder",
                         path, free_bytes * 1e-6, needed * 1e-6);
    return KILN_OK;
}

static const char *base_name(const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash == NULL ? path : slash + 1;
}

static int temporary_name(char temporary[KILN_PATH_SIZE], const char *path, struct kiln_error *error)
{
    const char *base = base_name(path);
    const int length = snprintf(temporary, KILN_PATH_SIZE, "%.*s.%s.part", (int)(base - path), path, base);
    if (length < 0 || length >= KILN_PATH_SIZE)
        return kiln_fail(error, KILN_CANNOT_CREATE, "the path '%.200s...' is longer than %d bytes: choose a shorter folder", path,
                         KILN_PATH_SIZE - 1);
    return KILN_OK;
}

int kiln_publish_name(char temporary[KILN_PATH_SIZE], const char *path, struct kiln_error *error)
{
    const int status = temporary_name(temporary, path, error);
    if (status != KILN_OK)
        return status;
    if (kiln_unlink(temporary) != 0 && errno != ENOENT)
        return cannot_create("a left-over file is in the way and cannot be removed;", temporary, error);
    return KILN_OK;
}

/* Where it fails there is nothing in the way: the name itself is for kiln_publish_name. */
void kiln_publish_sweep(const char *temporary)
{
    char folder[KILN_PATH_SIZE], file[KILN_PATH_SIZE];
    const char *base = base_name(temporary);
    (void)snprintf(folder, sizeof folder, "%.*s.", (int)(base - temporary), temporary);
    DIR *directory = opendir(folder);
    if (directory == NULL)
        return;
    const size_t length = strlen(base);
    for (const struct dirent *entry; (entry = readdir(directory)) != NULL;)
        if (strncmp(entry->d_name, base, length) == 0 && entry->d_name[length] != '\0' &&
            kiln_path_join(file, folder, entry->d_name, NULL) == KILN_OK)
            (void)unlink(file);
    (void)closedir(directory);
}

int kiln_publish_open(const char *temporary, int *descriptor, struct kiln_error *error)
{
    *descriptor = kiln_open(temporary, O_RDWR | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0666);
    return *descriptor >= 0 ? KILN_OK : cannot_create("the file", temporary, error);
}

/* Whether the open file is still what the name stands for: the one who had the lock before has renamed or removed it. */
static bool is_still_there(int descriptor, const char *path)
{
    struct stat own, there;
    return fstat(descriptor, &own) == 0 && lstat(path, &there) == 0 && own.st_dev == there.st_dev && own.st_ino == there.st_ino;
}

int kiln_publish_claim(char temporary[KILN_PATH_SIZE], const char *path, int *descriptor, struct kiln_error *error)
{
    struct stat found;
    *descriptor = -1;
    int status = temporary_name(temporary, path, error);
    while (status == KILN_OK) {
        *descriptor = kiln_open(temporary, O_RDWR | O_CREAT | O_NOFOLLOW | O_CLOEXEC, 0666);
        if (*descriptor < 0)
            return cannot_create("the file", path, error);
        while (flock(*descriptor, LOCK_EX) != 0 && errno == EINTR)
            ;
        if (is_still_there(*descriptor, temporary))
            break;
        (void)close(*descriptor);
    }
    if (status == KILN_OK && (fstat(*descriptor, &found) != 0 || !S_ISREG(found.st_mode) || kiln_cut(*descriptor, 0) != 0)) {
        status = cannot_create("what is in the way is no plain file, or cannot be written;", temporary, error);
        (void)close(*descriptor);
        *descriptor = -1;
    }
    return status;
}

static int sync_path(const char *path, int flags, struct kiln_error *error)
{
    const int descriptor = kiln_open(path, flags | O_CLOEXEC, 0);
    if (descriptor < 0)
        return kiln_fail_errno(error, KILN_IO, "'%s' cannot be opened to sync it", path);
    int status = KILN_OK;
    /* some file systems have nothing to sync for a folder and say EINVAL */
    if (kiln_fsync(descriptor) != 0 && !(errno == EINVAL && (flags & O_DIRECTORY) != 0))
        status = kiln_fail_errno(error, KILN_IO, "'%s' cannot be synced to disk", path);
    if (kiln_close(descriptor) != 0 && status == KILN_OK)
        status = kiln_fail_errno(error, KILN_IO, "'%s' cannot be closed", path);
    return status;
}

int kiln_publish_finish(const char *temporary, const char *path, struct kiln_error *error)
{
    int status = sync_path(temporary, O_RDONLY | O_NOFOLLOW, error);
    if (status == KILN_OK && kiln_rename(temporary, path) != 0)
        status = kiln_fail_errno(error, KILN_CANNOT_CREATE, "'%s' cannot be renamed to '%s'", temporary, path);
    if (status != KILN_OK) {
        kiln_publish_abandon(temporary);
        return status;
    }
    char folder[KILN_PATH_SIZE];
    const char *base = base_name(path);
    (void)snprintf(folder, sizeof folder, "%.*s.", (int)(base - path), path);
    return sync_path(folder, O_RDONLY | O_DIRECTORY, error);
}

void kiln_publish_abandon(const char *temporary) { (void)kiln_unlink(temporary); }

int kiln_write_all(int descriptor, const void *bytes, size_t size, size_t offset, const char *path, struct kiln_error *error)
{
    const char *next = bytes;
    while (size > 0) {
        const size_t step = size < (size_t)1 << 30 ? size : (size_t)1 << 30;
        const ssize_t written = pwrite(descriptor, next, step, (off_t)offset);
        if (written < 0 && errno == EINTR)
            continue;
        if (written <= 0)
            return kiln_fail_errno(error, KILN_IO, "'%s' cannot be written (%zu bytes at %zu)", path, size, offset);
        next += written;
        size -= (size_t)written;
        offset += (size_t)written;
    }
    return KILN_OK;
}

int kiln_publish_bytes(const char *path, const void *bytes, size_t size, struct kiln_error *error)
{
    char temporary[KILN_PATH_SIZE];
    int descriptor = -1;
    char *check = NULL;
    size_t check_size = 0;
    int status = kiln_publish_name(temporary, path, error);
    if (status != KILN_OK)
        return status;
    if ((status = kiln_publish_open(temporary, &descriptor, error)) != KILN_OK)
        return status;
    status = kiln_write_all(descriptor, bytes, size, 0, temporary, error);
    if (kiln_close(descriptor) != 0 && status == KILN_OK)
        status = kiln_fail_errno(error, KILN_IO, "'%s' cannot be closed", temporary);
    if (status == KILN_OK)
        status = kiln_read_file(temporary, size + 1, &check, &check_size, error);
    if (status == KILN_OK && (check_size != size || memcmp(check, bytes, size) != 0))
        status = kiln_fail(error, KILN_IO, "'%s' does not read back as it was written: the disk or file system is faulty", temporary);
    kiln_free(&check);
    if (status != KILN_OK) {
        kiln_publish_abandon(temporary);
        return status;
    }
    return kiln_publish_finish(temporary, path, error);
}

static int read_all(int descriptor, const char *path, size_t size, char *bytes, struct kiln_error *error)
{
    for (size_t at = 0; at < size;) {
        const ssize_t got = read(descriptor, bytes + at, size - at);
        if (got < 0 && errno == EINTR)
            continue;
        if (got < 0)
            return kiln_fail_errno(error, KILN_IO, "'%s' cannot be read at byte %zu", path, at);
        if (got == 0)
            return kiln_fail(error, KILN_IO, "'%s' ended at byte %zu of %zu while it was read", path, at, size);
        at += (size_t)got;
    }
    return KILN_OK;
}

int kiln_read_file(const char *path, size_t limit, char **bytes, size_t *size, struct kiln_error *error)
{
    *bytes = NULL;
    *size = 0;
    const int descriptor = kiln_open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK, 0); /* a pipe in the place of a file must not hang us */
    if (descriptor < 0)
        return kiln_fail_errno(error, 0, "'%s' cannot be opened", path);
    struct stat found;
    int status = KILN_OK;
    if (fstat(descriptor, &found) != 0)
        status = kiln_fail_errno(error, KILN_IO, "'%s' cannot be examined", path);
    else if (!S_ISREG(found.st_mode))
        status = kiln_fail(error, KILN_BAD_INPUT, "'%s' is not a plain file", path);
    else if ((size_t)found.st_size > limit)
        status = kiln_fail(error, KILN_BAD_INPUT, "'%s' has %zu bytes, more than the %zu expected at most", path,
                           (size_t)found.st_size, limit);
    if (status == KILN_OK)
        status = kiln_allocate(bytes, (size_t)found.st_size + 1, 1, "a file's bytes", error);
    if (status == KILN_OK)
        status = read_all(descriptor, path, (size_t)found.st_size, *bytes, error);
    (void)close(descriptor);
    if (status != KILN_OK)
        kiln_free(bytes);
    else
        *size = (size_t)found.st_size;
    return status;
}
