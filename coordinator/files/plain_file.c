#include "coordinator/files/plain_file.h"

#include <errno.h>
#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include "worker/base/calls.h"

int kiln_open_failed(const char *path, struct kiln_error *error)
{
    if (errno == ELOOP || errno == EXDEV)
        return kiln_fail(error, KILN_BAD_INPUT,
                         "'%s' is behind a symbolic link or leads out of the bake's folder: put the file itself there",
                         path);
    if (errno == ENXIO || errno == ENODEV)
        return kiln_fail(error, KILN_BAD_INPUT, "'%s' is not a plain file", path);
    if (errno == ENOSYS)
        return kiln_fail(
            error, KILN_SITE,
            "'%s': this kernel has no openat2(2), which confines readers to their folder; Linux 5.6 or later is needed",
            path);
    return kiln_fail_errno(error, errno == ENOTDIR ? KILN_NO_INPUT : 0, "'%s' cannot be opened", path);
}

int kiln_keep_plain(int *descriptor, const char *path, struct kiln_error *error)
{
    struct stat found;
    if (fstat(*descriptor, &found) == 0 && S_ISREG(found.st_mode))
        return KILN_OK;
    (void)close(*descriptor);
    *descriptor = -1;
    return kiln_fail(error, KILN_BAD_INPUT, "'%s' is not a plain file", path);
}

int kiln_open_plain(const char *path, int *descriptor, struct kiln_error *error)
{
    *descriptor = kiln_open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY, 0);
    return *descriptor < 0 ? kiln_open_failed(path, error) : kiln_keep_plain(descriptor, path, error);
}

int kiln_openat_plain(int folder, const char *name, int flags, const char *path, int *descriptor,
                      struct kiln_error *error)
{
    *descriptor = kiln_openat(folder, name, flags | O_NOFOLLOW | O_CLOEXEC | O_NONBLOCK | O_NOCTTY, 0666);
    if (*descriptor >= 0)
        return kiln_keep_plain(descriptor, path, error);
    return (flags & O_CREAT) != 0 && errno != ELOOP
               ? kiln_fail_errno(error, KILN_CANNOT_CREATE, "cannot create '%s'", path)
               : kiln_open_failed(path, error);
}
