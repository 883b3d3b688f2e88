#include "coordinator/cli/child.h"

#include <errno.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "coordinator/job/job_private.h"
#include "coordinator/job/options.h"
#include "coordinator/run/process.h"
#include "worker/base/calls.h"
#include "worker/base/memory.h"

extern char **environ;

enum { TEXT = 64 };

int kiln_child_program(char program[KILN_PATH_SIZE], struct kiln_error *error)
{
    const ssize_t length = readlink("/proc/self/exe", program, KILN_PATH_SIZE - 1);
    if (length <= 0)
        return kiln_fail_errno(error, KILN_SYSTEM, "the path of the running kiln cannot be found");
    program[length] = '\0';
    return KILN_OK;
}

void kiln_child_push(struct kiln_child *child, const char *text)
{
    if (child->status == KILN_OK && child->count + 1 >= KILN_CHILD_ARGUMENTS)
        child->status = kiln_fail(child->error, KILN_USAGE, "too many options");
    if (child->status == KILN_OK)
        child->status = kiln_allocate(&child->text[child->count], strlen(text) + 1, 1, "a command line", child->error);
    if (child->status == KILN_OK)
        memcpy(child->text[child->count++], text, strlen(text) + 1);
}

void kiln_child_push_number(struct kiln_child *child, const char *name, const char *format, double value)
{
    char text[TEXT];
    (void)snprintf(text, sizeof text, format, value);
    kiln_child_push(child, name);
    kiln_child_push(child, text);
}

static void push_option(struct kiln_child *child, const struct kiln_job *job, const struct kiln_option *option)
{
    char name[TEXT + 8], room[KILN_OPTION_TEXT];
    if (option->kind == KILN_OPTION_FLAG) {
        (void)snprintf(name, sizeof name, "--%s%s",
                       *(const bool *)(const void *)((const char *)job + option->offset) ? "" : "no-", option->name);
        kiln_child_push(child, name);
        return;
    }
    (void)snprintf(name, sizeof name, "--%s", option->name);
    kiln_child_push(child, name);
    kiln_child_push(child, kiln_option_argument(job, option, room));
}

void kiln_child_push_given(struct kiln_child *child, const struct kiln_job *job, uint32_t command,
                           const char *const *own)
{
    const struct kiln_job_owned *owned = job->strings;
    for (size_t i = 0; i < kiln_option_count; i++) {
        bool mine = false;
        for (const char *const *name = own; *name != NULL; name++)
            mine = mine || strcmp(*name, kiln_options[i].name) == 0;
        if (owned->given[i] && !mine && (kiln_options[i].commands & command) != 0)
            push_option(child, job, &kiln_options[i]);
    }
}

void kiln_child_clear(struct kiln_child *child)
{
    for (size_t i = 0; i < child->count; i++)
        kiln_free(&child->text[i]);
    child->count = 0;
}

/* Starts a process with the signal mask `signals`. */
static int start(struct kiln_child *child, int output, int errors, const sigset_t *signals, pid_t *process,
                 struct kiln_error *error)
{
    posix_spawn_file_actions_t actions;
    posix_spawnattr_t attributes;
    if (posix_spawn_file_actions_init(&actions) != 0)
        return kiln_fail(error, KILN_SYSTEM, "out of memory: starting %s", child->text[0]);
    if (posix_spawnattr_init(&attributes) != 0) {
        (void)posix_spawn_file_actions_destroy(&actions);
        return kiln_fail(error, KILN_SYSTEM, "out of memory: starting %s", child->text[0]);
    }
    errno = posix_spawn_file_actions_adddup2(&actions, output, STDOUT_FILENO);
    if (errno == 0)
        errno = posix_spawn_file_actions_adddup2(&actions, errors, STDERR_FILENO);
    if (errno == 0)
        errno = posix_spawnattr_setsigmask(&attributes, signals);
    if (errno == 0)
        errno = posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGMASK);
    if (errno == 0)
        errno = posix_spawnp(process, child->text[0], &actions, &attributes, child->text, environ);
    const int status = errno == 0
                           ? KILN_OK
                           : kiln_fail_errno(error, KILN_SITE, "%s cannot be started%s", child->text[0],
                                             strcmp(child->text[0], "mpirun") == 0 ? "; is Open MPI in PATH?" : "");
    (void)posix_spawn_file_actions_destroy(&actions);
    (void)posix_spawnattr_destroy(&attributes);
    return status;
}

/* Waits for a process while the signals of `set`, including SIGCHLD, are blocked. Signals that ask this process to end
 * are passed on, since mpirun would continue without it. */
static void wait_for(pid_t process, const sigset_t *set, struct kiln_child_end *end)
{
    int exit_status = 0;
    for (end->asked = 0; waitpid(process, &exit_status, WNOHANG) == 0;) {
        const int number = sigwaitinfo(set, NULL);
        if (number <= 0 || number == SIGCHLD)
            continue;
        end->asked = number;
        (void)kill(process, number == SIGHUP ? SIGTERM : number);
    }
    end->code = WIFEXITED(exit_status) ? WEXITSTATUS(exit_status) : KILN_SYSTEM;
}

int kiln_child_run(struct kiln_child *child, int output, int errors, struct kiln_child_end *end,
                   struct kiln_error *error)
{
    sigset_t set, before;
    pid_t process = 0;
    if (child->status != KILN_OK)
        return child->status;
    (void)sigemptyset(&set);
    (void)sigaddset(&set, SIGCHLD);
    (void)sigaddset(&set, SIGINT);
    (void)sigaddset(&set, SIGTERM);
    (void)sigaddset(&set, SIGUSR1);
    (void)sigaddset(&set, SIGHUP);
    (void)sigprocmask(SIG_BLOCK, &set, &before);
    kiln_process_take_along();
    const int status = start(child, output, errors, &before, &process, error);
    if (status == KILN_OK)
        wait_for(process, &set, end);
    (void)sigprocmask(SIG_SETMASK, &before, NULL);
    return status;
}

/* Implements kiln_output_folder_params.has_results: whether the folder has the table of the bench `context`, whole or
 * in part. */
static bool has_table(const char *directory, const void *context)
{
    static const char *const suffixes[] = {".csv", ".json"};
    char name[TEXT], path[KILN_PATH_SIZE];
    struct stat there;
    bool has = false;
    for (size_t i = 0; i < sizeof suffixes / sizeof *suffixes; i++) {
        (void)snprintf(name, sizeof name, "%s%s", (const char *)context, suffixes[i]);
        has = has || (kiln_path_join(path, directory, name, NULL) == KILN_OK && lstat(path, &there) == 0 &&
                      S_ISREG(there.st_mode));
    }
    return has;
}

int kiln_bench_folder_begin(struct kiln_output_folder **folder, const struct kiln_job *job, const char *name,
                            struct kiln_error *error)
{
    char owner[TEXT];
    (void)snprintf(owner, sizeof owner, "kiln bench %s", name);
    const struct kiln_output_folder_params params = {.directory = job->output,
                                                     .kind = KILN_FOLDER_OWNED,
                                                     .owner = owner,
                                                     .has_results = has_table,
                                                     .context = name,
                                                     .no_locks = job->faults.no_locks};
    return kiln_output_folder_begin(folder, &params, error);
}
