#include "coordinator/confined/confined.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#define STOP_SECONDS 0.2 /* seconds between two checks whether to stop */

extern char **environ;

static double now(void)
{
    struct timespec t;
    (void)clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static const char *program_of(const struct kiln_confined_call *call)
{
    return call->program != NULL ? call->program : "/proc/self/exe";
}

int kiln_confined_start(const struct kiln_confined_call *call, int answer, pid_t *pid, struct kiln_error *error)
{
    posix_spawn_file_actions_t actions;
    posix_spawnattr_t attributes;
    sigset_t none, all;
    (void)sigemptyset(&none);
    (void)sigfillset(&all);
    if (posix_spawn_file_actions_init(&actions) != 0)
        return kiln_fail(error, KILN_SYSTEM, "out of memory for a child process");
    if (posix_spawnattr_init(&attributes) != 0) {
        (void)posix_spawn_file_actions_destroy(&actions);
        return kiln_fail(error, KILN_SYSTEM, "out of memory for a child process");
    }
    /* The child inherits nothing else: no descriptor (MPI has sockets open), no signal mask or handler. */
    errno = call->input >= 0 ? posix_spawn_file_actions_adddup2(&actions, call->input, STDIN_FILENO)
                             : posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
    if (errno == 0)
        errno = posix_spawn_file_actions_adddup2(&actions, answer, STDOUT_FILENO);
    if (errno == 0)
        errno = call->output < KILN_CHILD_OUTPUT
                    ? 0
                    : posix_spawn_file_actions_adddup2(&actions, call->output, KILN_CHILD_OUTPUT);
    if (errno == 0)
        errno = posix_spawn_file_actions_addclosefrom_np(
            &actions, call->output < KILN_CHILD_OUTPUT ? KILN_CHILD_OUTPUT : KILN_CHILD_OUTPUT + 1);
    if (errno == 0)
        errno = posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETSIGMASK);
    if (errno == 0)
        errno = posix_spawnattr_setsigdefault(&attributes, &all);
    if (errno == 0)
        errno = posix_spawnattr_setsigmask(&attributes, &none);
    if (errno == 0)
        errno = posix_spawn(pid, program_of(call), &actions, &attributes, (char *const *)(uintptr_t)call->arguments,
                            environ);
    const int status =
        errno == 0 ? KILN_OK
                   : kiln_fail_errno(error, KILN_SYSTEM, "%s: cannot start the %s", program_of(call), call->what);
    (void)posix_spawn_file_actions_destroy(&actions);
    (void)posix_spawnattr_destroy(&attributes);
    return status;
}

/* Reads until the child closes the pipe. False when the time is over or a stop was requested. */
static bool listen(int pipe_read, double deadline, const struct kiln_stop *stop, char *text, size_t size)
{
    const double longest = stop != NULL ? STOP_SECONDS : 3600.0;
    size_t length = 0;
    for (;;) {
        struct pollfd wait = {.fd = pipe_read, .events = POLLIN};
        const double left = deadline - now();
        if (left <= 0.0 || kiln_stop_asked(stop))
            return false;
        const int ready = poll(&wait, 1, (int)((left < longest ? left : longest) * 1000.0) + 1);
        if (ready == 0 || (ready < 0 && errno == EINTR))
            continue;
        char block[1024];
        const ssize_t count = read(pipe_read, block, sizeof block);
        if (count < 0 && errno == EINTR)
            continue;
        if (count <= 0)
            break;
        const size_t kept = (size_t)count < size - 1 - length ? (size_t)count : size - 1 - length;
        memcpy(text + length, block, kept);
        length += kept;
    }
    text[length] = '\0';
    return true;
}

int kiln_confined_wait(pid_t pid)
{
    int state = 0;
    while (waitpid(pid, &state, 0) < 0)
        if (errno != EINTR)
            return -1;
    return state;
}

static const char *costly(const struct kiln_confined_call *call)
{
    return call->costly != NULL ? call->costly : "simplify the scene";
}

/* Whether the process itself caused the signal, so that the file it reads is to blame. All other signals were sent to
 * it. */
static bool is_own(int signal)
{
    static const int own[] = {SIGSEGV, SIGBUS, SIGABRT, SIGFPE, SIGILL, SIGSYS, SIGTRAP};
    bool is = false;
    for (size_t i = 0; i < sizeof own / sizeof *own; i++)
        is = is || own[i] == signal;
    return is;
}

/* The sentence about a child that a signal has ended. */
static int killed(const struct kiln_confined_call *call, int signal, const char *remedy, struct kiln_error *error)
{
    if (signal == SIGXCPU)
        return kiln_fail(error, KILN_BAD_INPUT,
                         "%.512s: reading it took more CPU time than is allowed for a file of its size; %s",
                         call->subject, costly(call));
    if (signal == SIGXFSZ)
        return kiln_fail(error, KILN_IO,
                         "%.512s: the %s wrote more than the file size limit of this process allows; raise it "
                         "(ulimit -f) and run again",
                         call->subject, call->what);
    if (signal == SIGKILL)
        return kiln_fail(error, KILN_SYSTEM,
                         "%.512s: the %s was killed from outside (signal %d: %s), most likely by the kernel because "
                         "the host or the job had no memory left; give it more, or run less beside it, and run again",
                         call->subject, call->what, signal, strsignal(signal));
    if (!is_own(signal))
        return kiln_fail(error, KILN_STOPPED,
                         "%.512s: the %s was ended from outside (signal %d: %s), not by this file; run again",
                         call->subject, call->what, signal, strsignal(signal));
    return kiln_fail(error, KILN_BAD_INPUT, "%.512s: %s died (signal %d: %s) on this file; %s", call->subject,
                     call->what, signal, strsignal(signal), remedy);
}

int kiln_confined_died(const struct kiln_confined_call *call, int state, struct kiln_error *error)
{
    const char *remedy = call->crashed != NULL ? call->crashed : "repair it or export it again as glTF";
    if (WIFSIGNALED(state))
        return killed(call, WTERMSIG(state), remedy, error);
    return kiln_fail(error, KILN_BAD_INPUT, "%.512s: %s died (exit status %d, no answer) on this file; %s",
                     call->subject, call->what, WIFEXITED(state) ? WEXITSTATUS(state) : -1, remedy);
}

int kiln_confined_late(const struct kiln_confined_call *call, struct kiln_error *error)
{
    return kiln_fail(error, KILN_BAD_INPUT, "%.512s: reading it took longer than %.0f s; %s", call->subject,
                     call->seconds, costly(call));
}

/* Turns the child's end and answer into a status and a sentence. */
static int judge(const struct kiln_confined_call *call, int state, const char *text, struct kiln_error *error)
{
    char *rest;
    const long status = strtol(text, &rest, 10);
    if (rest != text && *rest == '\n' && status == KILN_OK && WIFEXITED(state) && WEXITSTATUS(state) == 0)
        return KILN_OK;
    if (rest != text && *rest == '\n' && status != KILN_OK)
        return kiln_fail(error, (int)status, "%s", rest + 1);
    return kiln_confined_died(call, state, error);
}

int kiln_confined_run(const struct kiln_confined_call *call, struct kiln_error *error)
{
    int ends[2];
    pid_t pid = -1;
    char text[sizeof(struct kiln_error) + 64];
    if (pipe2(ends, O_CLOEXEC) != 0)
        return kiln_fail_errno(error, KILN_SYSTEM, "cannot create a pipe to the %s", call->what);
    int status = kiln_confined_start(call, ends[1], &pid, error);
    (void)close(ends[1]);
    if (status == KILN_OK) {
        const bool answered = listen(ends[0], now() + call->seconds, call->stop, text, sizeof text);
        if (!answered)
            (void)kill(pid, SIGKILL);
        const int state = kiln_confined_wait(pid);
        status = answered                      ? judge(call, state, text, error)
                 : kiln_stop_asked(call->stop) ? kiln_give_up(error)
                                               : kiln_confined_late(call, error);
    }
    (void)close(ends[0]);
    return status;
}
