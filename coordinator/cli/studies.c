#include "coordinator/cli/studies.h"

#include <dirent.h>
#include <errno.h>
#include <limits.h>
#include <signal.h>
#include <spawn.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "coordinator/files/folder.h"

enum { NAME_MOST = 40, NAMES_MOST = 4096, SENTENCE = 200 };

static const char *const own_benches[] = {"rays", "scaling"};
static const char ending[] = ".py";

/* ---- where they are ---- */

static bool is_folder(const char *path) { return access(path, R_OK | X_OK) == 0; }

/* Finds the path of this program and, in `folder`, the path of its folder. */
static int find_program(char program[KILN_PATH_SIZE], char folder[KILN_PATH_SIZE], struct kiln_error *error)
{
    const ssize_t length = readlink("/proc/self/exe", program, KILN_PATH_SIZE - 1);
    if (length <= 0)
        return kiln_fail_errno(error, KILN_SYSTEM, "the path of the running kiln cannot be found");
    program[length] = '\0';
    (void)snprintf(folder, KILN_PATH_SIZE, "%s", program);
    *strrchr(folder, '/') = '\0';
    return KILN_OK;
}

/* Finds the folder of studies. The path compiled in is used only by a program that still is in its build folder:
 * elsewhere anybody could own that path. */
static int find_folder(const char *beside, char path[KILN_PATH_SIZE], struct kiln_error *error)
{
    const char *given = getenv("KILN_STUDIES");
    if (given != NULL && given[0] != '\0')
        (void)snprintf(path, KILN_PATH_SIZE, "%s", given);
    else if (strcmp(beside, KILN_BUILD_FOLDER) == 0 && is_folder(KILN_SOURCE_STUDIES))
        (void)snprintf(path, KILN_PATH_SIZE, "%s", KILN_SOURCE_STUDIES);
    else if (kiln_path_join(path, beside, "../share/kiln/studies", error) != KILN_OK)
        return KILN_SYSTEM;
    return is_folder(path)
               ? KILN_OK
               : kiln_fail(error, KILN_SITE,
                           "the folder of the studies, %.500s, cannot be read: it belongs to kiln's sources "
                           "(jobs/studies) and installations; KILN_STUDIES names another place",
                           path);
}

static int find(char program[KILN_PATH_SIZE], char folder[KILN_PATH_SIZE], struct kiln_error *error)
{
    char beside[KILN_PATH_SIZE];
    const int status = find_program(program, beside, error);
    return status == KILN_OK ? find_folder(beside, folder, error) : status;
}

/* ---- names ---- */

static bool is_name(const char *text)
{
    const size_t length = strlen(text);
    return length > 0 && length <= NAME_MOST && strspn(text, "abcdefghijklmnopqrstuvwxyz-") == length && text[0] != '-';
}

/* Replaces a character: Python file names have '_' where names of benches have '-'. */
static void swap(char *name, char from, char to)
{
    for (; *name != '\0'; name++)
        *name = *name == from ? to : *name;
}

static int is_script(const struct dirent *entry)
{
    const size_t length = strlen(entry->d_name);
    return length > strlen(ending) && entry->d_name[0] != '_' &&
           strcmp(entry->d_name + length - strlen(ending), ending) == 0;
}

/* The first line of a script, without its quotes and its "kiln bench NAME: ". */
static void read_sentence(const char *folder, const char *file, char sentence[SENTENCE])
{
    char path[KILN_PATH_SIZE], line[SENTENCE] = "";
    FILE *script = kiln_path_join(path, folder, file, NULL) == KILN_OK ? fopen(path, "re") : NULL;
    if (script != NULL) {
        (void)!fgets(line, sizeof line, script);
        (void)fclose(script);
    }
    line[strcspn(line, "\n")] = '\0';
    const char *colon = strstr(line, ": ");
    (void)snprintf(sentence, SENTENCE, "%s", colon != NULL ? colon + 2 : line);
}

/* Calls `tell` for each script, by name. */
static void walk(const char *folder, void (*tell)(void *context, const char *folder, const char *file), void *context)
{
    struct dirent **entries = NULL;
    const int count = scandir(folder, &entries, is_script, alphasort);
    for (int i = 0; i < count; i++) {
        tell(context, folder, entries[i]->d_name);
        free(entries[i]);
    }
    free(entries);
}

static void name_of(const char *file, char name[NAME_MAX + 1])
{
    (void)snprintf(name, NAME_MAX + 1, "%.*s", (int)(strlen(file) - strlen(ending)), file);
    swap(name, '_', '-');
}

/* Who is told of each study. */
struct listener {
    kiln_study_tell tell;
    void *context;
};

static void tell_one(void *context, const char *folder, const char *file)
{
    const struct listener *listener = context;
    char name[NAME_MAX + 1], sentence[SENTENCE];
    name_of(file, name);
    read_sentence(folder, file, sentence);
    listener->tell(listener->context, name, sentence);
}

int kiln_studies_list(kiln_study_tell tell, void *context, struct kiln_error *error)
{
    char program[KILN_PATH_SIZE], folder[KILN_PATH_SIZE];
    struct listener listener = {tell, context};
    const int status = find(program, folder, error);
    if (status == KILN_OK)
        walk(folder, tell_one, &listener);
    return status;
}

static void add_name(void *context, const char *folder, const char *file)
{
    char name[NAME_MAX + 1], *names = context;
    const size_t used = strlen(names);
    (void)folder;
    name_of(file, name);
    (void)snprintf(names + used, NAMES_MOST - used, ", %s", name);
}

/* ---- starting ---- */

bool kiln_study_is_asked_for(int argc, char **argv)
{
    if (argc < 3 || strcmp(argv[1], "bench") != 0 || !is_name(argv[2]))
        return false;
    for (size_t i = 0; i < sizeof own_benches / sizeof *own_benches; i++)
        if (strcmp(argv[2], own_benches[i]) == 0)
            return false;
    return true;
}

/* The path of the study's script. */
static int find_script(const char *folder, const char *name, char path[KILN_PATH_SIZE], struct kiln_error *error)
{
    char file[NAME_MOST + sizeof ending], names[NAMES_MOST] = "rays, scaling";
    (void)snprintf(file, sizeof file, "%s%s", name, ending);
    swap(file, '-', '_');
    const int status = kiln_path_join(path, folder, file, error);
    if (status != KILN_OK || access(path, R_OK) == 0)
        return status;
    walk(folder, add_name, names);
    return kiln_fail(error, KILN_USAGE, "no bench is called '%s'; there are: %.900s", name, names);
}

/* Waits for the child, passes signals sent to this process on to it, and then ends with its status. Signals of the
 * terminal reach both processes anyway. */
static _Noreturn void end_with(pid_t child, const sigset_t *signals)
{
    int status = 0;
    while (waitpid(child, &status, WNOHANG) != child) {
        siginfo_t info;
        const int signal = sigwaitinfo(signals, &info);
        if (signal > 0 && signal != SIGCHLD && info.si_code <= 0)
            (void)kill(child, signal);
    }
    exit(WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status));
}

/* Runs a program found in PATH as a child, without a shell, and ends as it does; returns only the reason why it cannot
 * be started. */
static int run(const char *program, char **words)
{
    static const int passed[] = {SIGCHLD, SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGUSR1, SIGUSR2};
    sigset_t signals, before;
    posix_spawnattr_t attributes;
    pid_t child = 0;
    (void)sigemptyset(&signals);
    for (size_t i = 0; i < sizeof passed / sizeof *passed; i++)
        (void)sigaddset(&signals, passed[i]);
    (void)sigprocmask(SIG_BLOCK, &signals, &before);
    int failure = posix_spawnattr_init(&attributes);
    if (failure == 0) {
        (void)posix_spawnattr_setsigmask(&attributes, &before);
        (void)posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGMASK);
        failure = posix_spawnp(&child, program, NULL, &attributes, words, environ);
        (void)posix_spawnattr_destroy(&attributes);
    }
    if (failure == 0)
        end_with(child, &signals);
    (void)sigprocmask(SIG_SETMASK, &before, NULL);
    return failure;
}

int kiln_study_start(int argc, char **argv, struct kiln_error *error)
{
    char program[KILN_PATH_SIZE], folder[KILN_PATH_SIZE], script[KILN_PATH_SIZE];
    const char *given = getenv("KILN_PYTHON"), *python = given != NULL && given[0] != '\0' ? given : "python3";
    int status = find(program, folder, error);
    if (status == KILN_OK)
        status = find_script(folder, argv[2], script, error);
    if (status != KILN_OK)
        return status;
    char **words = calloc((size_t)argc + 2, sizeof *words);
    if (words == NULL)
        return kiln_fail(error, KILN_SYSTEM, "out of memory: starting a study");
    words[0] = (char *)(uintptr_t)python;
    words[1] = (char *)(uintptr_t) "-B"; /* writes no compiled modules beside the scripts */
    words[2] = script;
    memcpy(words + 3, argv + 3, (size_t)(argc - 3) * sizeof *words);
    (void)setenv("KILN", program, 1);
    (void)fflush(stdout);
    errno = run(python, words);
    status = kiln_fail_errno(error, KILN_SITE,
                             "kiln bench %s is a study in Python, and %.300s cannot be started: install python3, "
                             "python3-numpy and python3-matplotlib, or name an interpreter in KILN_PYTHON",
                             argv[2], python);
    free(words);
    return status;
}
