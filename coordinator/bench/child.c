#include "coordinator/bench/child.h"

#include <errno.h>
#include <fcntl.h>
#include <ftw.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "coordinator/job/job_private.h"
#include "coordinator/job/options.h"
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
    kiln_child_push(child, kiln_option_text(job, option, room));
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
    (void)sigaddset(&set, SIGHUP);
    (void)sigprocmask(SIG_BLOCK, &set, &before);
    const int status = start(child, output, errors, &before, &process, error);
    if (status == KILN_OK)
        wait_for(process, &set, end);
    (void)sigprocmask(SIG_SETMASK, &before, NULL);
    return status;
}

/* Runs the command with stdout and stderr at these descriptors. */
static int run_into(struct kiln_child *child, int output, int errors, int *code, char said[KILN_CHILD_SAID],
                    struct kiln_error *error)
{
    struct kiln_child_end end = {0};
    const int status = kiln_child_run(child, output, errors, &end, error);
    *code = end.code;
    if (status == KILN_OK && end.asked != 0)
        return kiln_fail(error, KILN_STOPPED, "stopped by %s; run the same command again", strsignal(end.asked));
    const ssize_t length = status == KILN_OK ? pread(errors, said, KILN_CHILD_SAID - 1, 0) : 0;
    said[length > 0 ? length : 0] = '\0';
    return status;
}

/* Makes or empties a file. */
static int open_empty(const char *path, int *descriptor, struct kiln_error *error)
{
    *descriptor = open(path, O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC | O_NOFOLLOW, 0600);
    return *descriptor >= 0 ? KILN_OK : kiln_fail_errno(error, KILN_CANNOT_CREATE, "cannot make the file %.500s", path);
}

/* Runs the command with stdout at this descriptor, which it closes, and stderr in the file `path`. */
static int run_with_errors_in(const char *path, struct kiln_child *child, int output, int *code,
                              char said[KILN_CHILD_SAID], struct kiln_error *error)
{
    int errors = -1;
    int status = open_empty(path, &errors, error);
    if (status == KILN_OK)
        status = run_into(child, output, errors, code, said, error);
    if (errors >= 0)
        (void)close(errors);
    (void)close(output);
    return status;
}

int kiln_child_run_quietly(struct kiln_child *child, const char *path, int *code, char said[KILN_CHILD_SAID],
                           struct kiln_error *error)
{
    const int none = open("/dev/null", O_WRONLY | O_CLOEXEC);
    if (none < 0)
        return kiln_fail_errno(error, KILN_SYSTEM, "/dev/null cannot be opened");
    return run_with_errors_in(path, child, none, code, said, error);
}

int kiln_child_run_for_json(struct kiln_child *child, const char *answer, const char *path, int *code,
                            char said[KILN_CHILD_SAID], json_t **printed, struct kiln_error *error)
{
    json_error_t where;
    int output = -1;
    *printed = NULL;
    int status = open_empty(answer, &output, error);
    if (status == KILN_OK)
        status = run_with_errors_in(path, child, output, code, said, error);
    if (status != KILN_OK || *code != KILN_OK)
        return status;
    *printed = json_load_file(answer, 0, &where);
    return *printed != NULL ? KILN_OK
                            : kiln_fail(error, KILN_BUG, "%s %s --json printed no JSON: %s", child->text[0],
                                        child->text[1], where.text);
}

const char *kiln_child_sentence(const char *said)
{
    static const char begin[] = "kiln: error: ";
    const char *sentence = strstr(said, begin);
    return sentence != NULL ? sentence + strlen(begin) : said;
}

int kiln_child_failure(const char *what, int code, const char *said, struct kiln_error *error)
{
    if (code == KILN_OK)
        return KILN_OK;
    return kiln_fail(error, code >= KILN_USAGE && code <= KILN_SITE ? code : KILN_SYSTEM, "%s failed with %d: %.900s",
                     what, code, kiln_child_sentence(said));
}

int kiln_child_report(const char *folder, json_t **report, struct kiln_error *error)
{
    char path[KILN_PATH_SIZE];
    json_error_t where;
    const int status = kiln_path_join(path, folder, "run.json", error);
    if (status != KILN_OK)
        return status;
    *report = json_load_file(path, 0, &where);
    return *report != NULL ? KILN_OK : kiln_fail(error, KILN_BAD_INPUT, "'%s' cannot be read: %s", path, where.text);
}

static int remove_entry(const char *path, const struct stat *status, int type, struct FTW *walk)
{
    (void)status, (void)type, (void)walk;
    (void)remove(path);
    return 0;
}

void kiln_remove_tree(const char *path) { (void)nftw(path, remove_entry, 16, FTW_DEPTH | FTW_PHYS); }
