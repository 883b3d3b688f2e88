#include "coordinator/files/publish.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <time.h>
#include <unistd.h>

#include "coordinator/files/plain_file.h"
#include "worker/base/calls.h"
#include "worker/base/memory.h"

static int cannot_create(const char *what, const char *path, struct kiln_error *error)
{
    const int status = errno == EACCES || errno == EPERM ? KILN_PERMISSION : KILN_CANNOT_CREATE;
    return kiln_fail_errno(error, status, "%s '%s' cannot be created", what, path);
}

int kiln_require_space(const char *path, uint64_t bytes, struct kiln_error *error)
{
    struct statvfs found;
    if (statvfs(path, &found) != 0)
        return kiln_fail_errno(error, KILN_IO, "the free space of '%s' cannot be found out", path);
    const double free_bytes = (double)found.f_bavail * (double)found.f_frsize, needed = 1.1 * (double)bytes;
    if (needed > free_bytes)
        return kiln_fail(
            error, KILN_IO,
            "the disk of '%s' has %.3f MB left and up to %.3f MB are to be written: make room or choose another folder",
            path, free_bytes * 1e-6, needed * 1e-6);
    return KILN_OK;
}

/* ---- classification of a user's path: file, pipe, device ---- */

int kiln_own_descriptor(const char *path)
{
    char folder[KILN_PATH_SIZE], own[64], *end = NULL;
    if (strcmp(path, "/dev/stdout") == 0)
        return STDOUT_FILENO;
    if (strcmp(path, "/dev/stderr") == 0)
        return STDERR_FILENO;
    const char *slash = strrchr(path, '/');
    if (slash == NULL || slash[1] < '0' || slash[1] > '9')
        return -1;
    const long number = strtol(slash + 1, &end, 10);
    (void)snprintf(folder, sizeof folder, "%.*s", (int)(slash - path), path);
    (void)snprintf(own, sizeof own, "/proc/%ld/fd", (long)getpid());
    char *real = realpath(folder, NULL);
    const bool is_own = real != NULL && strcmp(real, own) == 0 && *end == '\0' && number <= 1 << 20;
    free(real);
    return is_own ? (int)number : -1;
}

/* Finds out whether the path names a pipe or device (*stream), and the descriptor of this process if it names one.
 * Opens nothing. */
static int classify(const char *path, bool *stream, int *descriptor, struct kiln_error *error)
{
    struct stat found, there;
    const size_t length = strlen(path);
    *descriptor = kiln_own_descriptor(path);
    *stream = *descriptor >= 0;
    if (*stream)
        return fcntl(*descriptor, F_GETFD) >= 0 ? KILN_OK
                                                : kiln_fail_errno(error, KILN_CANNOT_CREATE, "'%s' is not open", path);
    if (length == 0)
        return kiln_fail(error, KILN_USAGE, "an output's name is empty");
    const bool is_there = lstat(path, &found) == 0;
    const bool follows = is_there && S_ISLNK(found.st_mode) && stat(path, &there) == 0;
    const mode_t mode = follows ? there.st_mode : is_there ? found.st_mode : S_IFREG;
    if (path[length - 1] == '/' || S_ISDIR(mode))
        return kiln_fail(error, KILN_CANNOT_CREATE, "'%s' is a folder: name a file", path);
    if (S_ISBLK(mode) || S_ISSOCK(mode))
        return kiln_fail(error, KILN_CANNOT_CREATE, "'%s' is a %s: name a file", path,
                         S_ISBLK(mode) ? "disk" : "socket");
    *stream = S_ISCHR(mode) || S_ISFIFO(mode);
    if (*stream && follows && found.st_uid != 0 && found.st_uid != geteuid())
        return kiln_fail(error, KILN_PERMISSION, "'%s' is another user's link to a device: name the device itself",
                         path);
    return KILN_OK;
}

/* Opens a pipe or device. A pipe without a reader is refused, since writing to it would block for ever. */
static int open_stream(const char *path, int own, int *stream, struct kiln_error *error)
{
    *stream =
        own >= 0 ? fcntl(own, F_DUPFD_CLOEXEC, 3) : kiln_open(path, O_WRONLY | O_NONBLOCK | O_NOCTTY | O_CLOEXEC, 0);
    if (*stream < 0 && errno == ENXIO)
        return kiln_fail(error, KILN_CANNOT_CREATE,
                         "'%s' is a pipe that nobody reads from: start its reader first, or name a file", path);
    if (*stream < 0)
        return kiln_fail_errno(error, errno == EACCES || errno == EPERM ? KILN_PERMISSION : KILN_CANNOT_CREATE,
                               "'%s' cannot be written to", path);
    if (own < 0)
        (void)fcntl(*stream, F_SETFL, fcntl(*stream, F_GETFL) & ~O_NONBLOCK);
    return KILN_OK;
}

/* ---- begin ---- */

static int name_place(struct kiln_publish *p, const char *directory, const char *name, struct kiln_error *error)
{
    const char *slash = strrchr(name, '/'), *base = slash == NULL ? name : slash + 1;
    char folder[KILN_PATH_SIZE];
    const int length = snprintf(folder, sizeof folder, "%.*s",
                                slash == NULL                        ? 0
                                : slash == name && directory == NULL ? 1
                                                                     : (int)(slash - name),
                                name);
    if (length >= KILN_PATH_SIZE || strlen(base) >= sizeof p->base || base[0] == '\0')
        return kiln_fail(error, KILN_CANNOT_CREATE, "the path '%.200s...' is too long for a file's name", name);
    int status = directory != NULL ? kiln_folder_open(&p->folder, directory, folder, false, error)
                                   : kiln_folder_open(&p->folder, folder[0] == '\0' ? "." : folder, NULL, false, error);
    if (status != KILN_OK && directory == NULL)
        return cannot_create("the file", name, error);
    if (status != KILN_OK)
        return status == KILN_NO_INPUT ? KILN_CANNOT_CREATE : status;
    (void)snprintf(p->base, sizeof p->base, "%s", base);
    (void)snprintf(p->aside, sizeof p->aside, ".%s.part", base);
    (void)snprintf(p->opens, sizeof p->opens, "/proc/self/fd/%d/%s", p->folder.descriptor, p->aside);
    if (slash == NULL && directory == NULL)
        p->folder.path[0] = '\0'; /* makes messages say "a.png" and not "./a.png" */
    const char *between = p->folder.path[0] == '\0' || strcmp(p->folder.path, "/") == 0 ? "" : "/";
    const int whole = snprintf(p->path, sizeof p->path, "%s%s%s", p->folder.path, between, p->base);
    const int part = snprintf(p->temporary, sizeof p->temporary, "%s%s%s", p->folder.path, between, p->aside);
    if (whole >= KILN_PATH_SIZE || part >= KILN_PATH_SIZE)
        return kiln_fail(error, KILN_CANNOT_CREATE,
                         "the path '%.200s...' is longer than %d bytes: choose a shorter folder", p->path,
                         KILN_PATH_SIZE - 1);
    return KILN_OK;
}

static int name_stream(struct kiln_publish *p, const char *path, int own, struct kiln_error *error)
{
    (void)snprintf(p->path, sizeof p->path, "%s", path);
    (void)snprintf(p->temporary, sizeof p->temporary, "%s", path);
    int status = open_stream(path, own, &p->stream, error);
    if (status == KILN_OK && (p->scratch = memfd_create("kiln output", MFD_CLOEXEC)) < 0)
        status = kiln_fail_errno(error, KILN_SYSTEM, "a file in memory cannot be made");
    (void)snprintf(p->opens, sizeof p->opens, "/proc/self/fd/%d", p->scratch);
    return status;
}

/* Begins a publication without removing an existing temporary file. */
static int begin(struct kiln_publish *p, const char *directory, const char *name, struct kiln_error *error)
{
    bool stream = false;
    int own = -1;
    p->folder.descriptor = p->stream = p->scratch = -1;
    p->left = NULL;
    p->path[0] = p->temporary[0] = '\0';
    int status =
        directory != NULL ? kiln_check_below(directory, name, false, error) : classify(name, &stream, &own, error);
    if (status == KILN_OK)
        status = stream ? name_stream(p, name, own, error) : name_place(p, directory, name, error);
    if (status != KILN_OK)
        kiln_publish_close(p);
    return status;
}

static void note_aside(struct kiln_publish *p)
{
    p->left = p->stream >= 0 ? NULL : kiln_left_note(p->folder.descriptor, p->aside);
}

static int unlink_aside(const struct kiln_publish *p) { return kiln_unlinkat(p->folder.descriptor, p->aside, 0); }

int kiln_publish_begin(struct kiln_publish *p, const char *directory, const char *name, struct kiln_error *error)
{
    int status = begin(p, directory, name, error);
    if (status == KILN_OK && p->stream < 0 && unlink_aside(p) != 0 && errno != ENOENT) {
        status = cannot_create("a file that an earlier process left cannot be removed;", p->temporary, error);
        kiln_publish_close(p);
    }
    if (status == KILN_OK)
        note_aside(p); /* before the file exists: libraries create it, too, and with several ranks any of them may */
    return status;
}

void kiln_publish_close(struct kiln_publish *p)
{
    kiln_left_forget(&p->left);
    kiln_folder_close(&p->folder);
    if (p->stream >= 0)
        (void)close(p->stream);
    if (p->scratch >= 0)
        (void)close(p->scratch);
    p->stream = p->scratch = -1;
}

/* Removes outdated temporary files. Errors are ignored, since these files are harmless; the publication's own temporary
 * file is removed by kiln_publish_begin. */
void kiln_publish_sweep(const struct kiln_publish *p)
{
    const int copy =
        p->folder.descriptor < 0 ? -1 : kiln_openat(p->folder.descriptor, ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC, 0);
    DIR *directory = copy < 0 ? NULL : fdopendir(copy);
    if (directory == NULL) {
        if (copy >= 0)
            (void)close(copy);
        return;
    }
    const size_t length = strlen(p->aside);
    for (const struct dirent *entry; (entry = readdir(directory)) != NULL;)
        if (strncmp(entry->d_name, p->aside, length) == 0 && entry->d_name[length] != '\0')
            (void)kiln_unlinkat(p->folder.descriptor, entry->d_name, 0);
    (void)closedir(directory);
}

static int open_aside(const struct kiln_publish *p, int flags)
{
    return p->stream >= 0 ? fcntl(p->scratch, F_DUPFD_CLOEXEC, 3)
                          : kiln_openat(p->folder.descriptor, p->aside, flags | O_NOFOLLOW | O_CLOEXEC, 0666);
}

int kiln_publish_open(struct kiln_publish *p, int *descriptor, struct kiln_error *error)
{
    *descriptor = open_aside(p, O_RDWR | O_CREAT | O_EXCL);
    return *descriptor >= 0 ? KILN_OK : cannot_create("the file", p->path, error);
}

int kiln_publish_join(struct kiln_publish *p, const char *directory, const char *name, int *descriptor,
                      struct kiln_error *error)
{
    int status = begin(p, directory, name, error);
    if (status != KILN_OK)
        return status;
    *descriptor = open_aside(p, O_RDWR);
    return *descriptor >= 0 ? KILN_OK
                            : kiln_fail_errno(error, KILN_IO, "'%s', which another rank has created, cannot be opened",
                                              p->temporary);
}

/* Opens the temporary file again, to read it back. The caller closes *descriptor. */
static int reopen(const struct kiln_publish *p, int *descriptor, struct kiln_error *error)
{
    *descriptor = open_aside(p, O_RDONLY);
    return *descriptor >= 0 ? KILN_OK : kiln_fail_errno(error, KILN_IO, "'%s' cannot be opened", p->temporary);
}

int kiln_publish_check(const char *directory, const char *name, struct kiln_error *error)
{
    struct kiln_publish p;
    bool stream = false;
    int own, descriptor = -1;
    if (directory == NULL) {
        const int status = classify(name, &stream, &own, error);
        if (status != KILN_OK || stream)
            return status; /* a pipe must not be opened and closed, since its reader would take that for the end */
    }
    int status = kiln_publish_begin(&p, directory, name, error);
    if (status == KILN_OK && (status = kiln_publish_open(&p, &descriptor, error)) == KILN_OK)
        (void)close(descriptor);
    kiln_publish_abandon(&p);
    return status;
}

/* Whether the open file still has the temporary name; the previous holder of the lock may have renamed or removed it.
 */
static bool is_still_there(const struct kiln_publish *p, int descriptor)
{
    struct stat own, there;
    return fstat(descriptor, &own) == 0 && fstatat(p->folder.descriptor, p->aside, &there, AT_SYMLINK_NOFOLLOW) == 0 &&
           own.st_dev == there.st_dev && own.st_ino == there.st_ino;
}

int kiln_publish_claim(struct kiln_publish *p, const char *directory, const char *name, int *descriptor,
                       struct kiln_error *error)
{
    struct stat found;
    *descriptor = -1;
    int status = begin(p, directory, name, error);
    while (status == KILN_OK) {
        *descriptor = open_aside(p, O_RDWR | O_CREAT | O_NONBLOCK);
        if (*descriptor < 0) {
            status = cannot_create("the file", p->path, error);
            break;
        }
        while (p->stream < 0 && flock(*descriptor, LOCK_EX) != 0 && errno == EINTR)
            ;
        if (p->stream >= 0 || is_still_there(p, *descriptor))
            break;
        (void)close(*descriptor);
        *descriptor = -1;
    }
    if (status == KILN_OK &&
        (fstat(*descriptor, &found) != 0 || !S_ISREG(found.st_mode) || kiln_truncate(*descriptor, 0) != 0)) {
        status = cannot_create("what has this name is not a regular file, or cannot be written;", p->temporary, error);
        (void)close(*descriptor);
        *descriptor = -1;
    }
    if (status == KILN_OK)
        note_aside(p);
    else
        kiln_publish_close(p);
    return status;
}

/* ---- end ---- */

static int sync_aside(const struct kiln_publish *p, struct kiln_error *error)
{
    const int descriptor = open_aside(p, O_RDONLY);
    if (descriptor < 0)
        return kiln_fail_errno(error, KILN_IO, "'%s' cannot be opened to sync it", p->temporary);
    int status = KILN_OK;
    if (kiln_fsync(descriptor) != 0)
        status = kiln_fail_errno(error, KILN_IO, "'%s' cannot be synced to disk", p->temporary);
    if (kiln_close(descriptor) != 0 && status == KILN_OK)
        status = kiln_fail_errno(error, KILN_IO, "'%s' cannot be closed", p->temporary);
    return status;
}

static int rename_aside(const struct kiln_publish *p) { return kiln_renameat(p->folder.descriptor, p->aside, p->base); }

/* Writes like write(), but reports EPIPE instead of raising SIGPIPE if a pipe's reader has ended. */
static ssize_t write_without_signal(int descriptor, const void *bytes, size_t size)
{
    sigset_t pipe, before;
    const struct timespec at_once = {0, 0};
    (void)sigemptyset(&pipe);
    (void)sigaddset(&pipe, SIGPIPE);
    (void)pthread_sigmask(SIG_BLOCK, &pipe, &before);
    const ssize_t written = write(descriptor, bytes, size);
    const int number = errno;
    if (written < 0 && number == EPIPE && sigismember(&before, SIGPIPE) == 0)
        (void)sigtimedwait(&pipe, NULL, &at_once);
    (void)pthread_sigmask(SIG_SETMASK, &before, NULL);
    errno = number;
    return written;
}

/* Copies the buffer to the pipe or device. */
static int pass_on(const struct kiln_publish *p, struct kiln_error *error)
{
    static const size_t block = 1 << 16;
    char *bytes = NULL;
    int status = kiln_allocate(&bytes, block, 1, "an output's bytes", error);
    for (off_t at = 0; status == KILN_OK;) {
        const ssize_t got = pread(p->scratch, bytes, block, at);
        if (got == 0)
            break;
        const ssize_t written = got < 0 ? -1 : write_without_signal(p->stream, bytes, (size_t)got);
        if (written < 0 && errno != EINTR)
            status = kiln_fail_errno(error, KILN_IO, "'%s' cannot be written to", p->path);
        at += written > 0 ? written : 0;
    }
    kiln_free(&bytes);
    return status;
}

int kiln_publish_finish(struct kiln_publish *p, struct kiln_error *error)
{
    int status = p->stream >= 0 ? pass_on(p, error) : sync_aside(p, error);
    if (p->stream < 0 && status == KILN_OK && rename_aside(p) != 0)
        status = kiln_fail_errno(error, KILN_CANNOT_CREATE, "'%s' cannot be renamed to '%s'", p->temporary, p->path);
    if (status != KILN_OK)
        kiln_publish_abandon(p);
    else if (p->stream < 0)
        status = kiln_folder_sync(&p->folder, error);
    kiln_publish_close(p);
    return status;
}

int kiln_publish_replace(struct kiln_publish *p, struct kiln_error *error)
{
    if (rename_aside(p) != 0)
        return kiln_fail_errno(error, KILN_CANNOT_CREATE, "'%s' cannot be renamed to '%s'", p->temporary, p->path);
    kiln_publish_close(p);
    return KILN_OK;
}

void kiln_publish_abandon(struct kiln_publish *p)
{
    if (p->folder.descriptor >= 0)
        (void)unlink_aside(p);
    kiln_publish_close(p);
}

int kiln_write_all(int descriptor, const void *bytes, size_t size, size_t offset, const char *path,
                   struct kiln_error *error)
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

static int read_all(int descriptor, const char *path, size_t size, char *bytes, struct kiln_error *error)
{
    for (size_t at = 0; at < size;) {
        const ssize_t got = pread(descriptor, bytes + at, size - at, (off_t)at);
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

static int check_written(const struct kiln_publish *p, const void *bytes, size_t size, struct kiln_error *error)
{
    int descriptor = -1;
    char *check = NULL;
    size_t check_size = 0;
    int status;
    KILN_TRY(reopen(p, &descriptor, error));
    KILN_TRY(kiln_read_descriptor(descriptor, p->temporary, size + 1, &check, &check_size, error));
    if (check_size != size || memcmp(check, bytes, size) != 0)
        KILN_TRY(kiln_fail(error, KILN_IO,
                           "'%s' does not read back as it was written: the disk or file system is faulty",
                           p->temporary));
end:
    kiln_free(&check);
    return status;
}

int kiln_publish_bytes_below(const char *directory, const char *name, const void *bytes, size_t size,
                             struct kiln_error *error)
{
    struct kiln_publish p;
    int descriptor = -1;
    int status = kiln_publish_begin(&p, directory, name, error);
    if (status == KILN_OK)
        status = kiln_publish_open(&p, &descriptor, error);
    if (status != KILN_OK) {
        kiln_publish_close(&p);
        return status;
    }
    status = kiln_write_all(descriptor, bytes, size, 0, p.temporary, error);
    if (kiln_close(descriptor) != 0 && status == KILN_OK)
        status = kiln_fail_errno(error, KILN_IO, "'%s' cannot be closed", p.temporary);
    if (status == KILN_OK)
        status = check_written(&p, bytes, size, error);
    if (status == KILN_OK)
        return kiln_publish_finish(&p, error);
    kiln_publish_abandon(&p);
    return status;
}

int kiln_publish_bytes(const char *path, const void *bytes, size_t size, struct kiln_error *error)
{
    return kiln_publish_bytes_below(NULL, path, bytes, size, error);
}

int kiln_read_open(int descriptor, const char *path, size_t limit, char **bytes, size_t *size, struct kiln_error *error)
{
    struct stat found;
    *bytes = NULL;
    *size = 0;
    if (fstat(descriptor, &found) != 0)
        return kiln_fail_errno(error, KILN_IO, "'%s' cannot be examined", path);
    if (!S_ISREG(found.st_mode))
        return kiln_fail(error, KILN_BAD_INPUT, "'%s' is not a plain file", path);
    if ((size_t)found.st_size > limit)
        return kiln_fail(error, KILN_BAD_INPUT, "'%s' has %zu bytes, more than the %zu expected at most", path,
                         (size_t)found.st_size, limit);
    int status = kiln_allocate(bytes, (size_t)found.st_size + 1, 1, "a file's bytes", error);
    if (status == KILN_OK)
        status = read_all(descriptor, path, (size_t)found.st_size, *bytes, error);
    if (status == KILN_OK)
        *size = (size_t)found.st_size;
    else
        kiln_free(bytes);
    return status;
}

int kiln_read_descriptor(int descriptor, const char *path, size_t limit, char **bytes, size_t *size,
                         struct kiln_error *error)
{
    const int status = kiln_read_open(descriptor, path, limit, bytes, size, error);
    (void)close(descriptor);
    return status;
}

int kiln_read_file(const char *path, size_t limit, char **bytes, size_t *size, struct kiln_error *error)
{
    int descriptor;
    const int status = kiln_open_plain(path, &descriptor, error);
    *bytes = NULL;
    *size = 0;
    return status == KILN_OK ? kiln_read_descriptor(descriptor, path, limit, bytes, size, error) : status;
}
