#include <ctype.h>
#include <errno.h>
#include <signal.h>
#include <spawn.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include "coordinator/batch/batch.h"

extern char **environ;

/* Restores the library path that kiln's launcher in a relocatable folder has replaced for kiln. Programs of the host,
 * such as sbatch, need the earlier path. */
static void restore_library_path(void)
{
    const char *before = getenv("KILN_HOST_LIBRARY_PATH");
    if (before != NULL && before[0] != '\0')
        (void)setenv("LD_LIBRARY_PATH", before, 1);
    else if (before != NULL)
        (void)unsetenv("LD_LIBRARY_PATH");
    (void)unsetenv("KILN_HOST_LIBRARY_PATH");
    (void)unsetenv("KILN_LAUNCHER");
}

/* Starts sbatch with one socket as its standard input and output. So this process gets no SIGPIPE if sbatch ends
 * early. */
static int start(int theirs, pid_t *process)
{
    char *arguments[] = {"sbatch", "--parsable", NULL};
    posix_spawn_file_actions_t actions;
    if (posix_spawn_file_actions_init(&actions) != 0)
        return ENOMEM;
    int failure = posix_spawn_file_actions_adddup2(&actions, theirs, STDIN_FILENO);
    if (failure == 0)
        failure = posix_spawn_file_actions_adddup2(&actions, theirs, STDOUT_FILENO);
    if (failure == 0)
        failure = posix_spawnp(process, arguments[0], &actions, NULL, arguments, environ);
    (void)posix_spawn_file_actions_destroy(&actions);
    return failure;
}

static void send_all(int descriptor, const char *script, size_t length)
{
    for (size_t at = 0; at < length;) {
        const ssize_t sent = send(descriptor, script + at, length - at, MSG_NOSIGNAL);
        if (sent < 0 && errno != EINTR)
            break; /* sbatch has ended; its exit status tells why */
        at += sent > 0 ? (size_t)sent : 0;
    }
    (void)shutdown(descriptor, SHUT_WR);
}

static void receive_all(int descriptor, char *text, size_t size)
{
    size_t used = 0;
    for (ssize_t got = 1; got != 0 && used + 1 < size;) {
        got = recv(descriptor, text + used, size - 1 - used, 0);
        if (got < 0 && errno != EINTR)
            break;
        used += got > 0 ? (size_t)got : 0;
    }
    text[used] = '\0';
}

/* Reads the job's number from "123" or "123;cluster". */
static int take_id(const char *answer, char **id, struct kiln_error *error)
{
    const size_t digits = strspn(answer, "0123456789");
    if (digits == 0)
        return kiln_fail(error, KILN_SITE, "sbatch answered '%.200s' instead of a job number", answer);
    *id = strndup(answer, digits);
    return *id != NULL ? KILN_OK : kiln_fail(error, KILN_SYSTEM, "out of memory for a job's number");
}

int kiln_batch_submit(const char *script, size_t length, char **id, struct kiln_error *error)
{
    int ends[2], exit_status = 0;
    char answer[256];
    pid_t process = 0;
    if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0)
        return kiln_fail_errno(error, KILN_SYSTEM, "cannot make a pair of sockets for sbatch");
    restore_library_path();
    errno = start(ends[1], &process);
    const int failure = errno;
    (void)close(ends[1]);
    if (failure == 0) {
        send_all(ends[0], script, length);
        receive_all(ends[0], answer, sizeof answer);
        while (waitpid(process, &exit_status, 0) < 0 && errno == EINTR)
            ;
    }
    (void)close(ends[0]);
    if (failure == ENOENT)
        return kiln_fail(error, KILN_SITE,
                         "there is no sbatch in PATH; submit from a login node of a Slurm cluster, or write the script "
                         "with --dry-run");
    if (failure != 0)
        return kiln_fail_errno(error, KILN_SITE, "cannot start sbatch");
    if (!WIFEXITED(exit_status) || WEXITSTATUS(exit_status) != 0)
        return kiln_fail(error, KILN_SITE, "sbatch refused the job and printed why above; --dry-run shows the script");
    return take_id(answer, id, error);
}
