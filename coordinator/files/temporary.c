#include "coordinator/files/temporary.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "coordinator/files/folder.h"
#include "worker/base/calls.h"

/* Replaces O_TMPFILE on file systems without it. Signals are blocked, so that none can end the process between creating
 * and unlinking. */
static int make_and_unlink(const char *folder)
{
    char path[KILN_PATH_SIZE];
    sigset_t all, before;
    if (kiln_path_join(path, folder, "kiln-XXXXXX", NULL) != KILN_OK) {
        errno = ENAMETOOLONG;
        return -1;
    }
    (void)sigfillset(&all);
    (void)pthread_sigmask(SIG_SETMASK, &all, &before);
    const int descriptor = mkostemp(path, O_CLOEXEC);
    const int number = errno;
    if (descriptor >= 0)
        (void)unlink(path);
    (void)pthread_sigmask(SIG_SETMASK, &before, NULL);
    errno = number;
    return descriptor;
}

int kiln_temporary_make(struct kiln_temporary *temporary, struct kiln_error *error)
{
    const char *base = getenv("TMPDIR");
    const char *folder = base != NULL && base[0] != '\0' ? base : "/tmp";
    temporary->scene_file[0] = '\0';
    temporary->descriptor = kiln_open(folder, O_TMPFILE | O_RDWR | O_CLOEXEC, 0600);
    if (temporary->descriptor < 0)
        temporary->descriptor = make_and_unlink(folder);
    if (temporary->descriptor < 0)
        return kiln_fail_errno(error, KILN_CANNOT_CREATE, "a temporary file in %.500s cannot be created", folder);
    (void)snprintf(temporary->scene_file, sizeof temporary->scene_file, "/proc/self/fd/%d", temporary->descriptor);
    return KILN_OK;
}

void kiln_temporary_remove(struct kiln_temporary *temporary)
{
    if (temporary->descriptor >= 0 && temporary->scene_file[0] != '\0')
        (void)close(temporary->descriptor);
    temporary->descriptor = -1;
    temporary->scene_file[0] = '\0';
}
