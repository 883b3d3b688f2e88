/* A child process that runs kiln, or mpirun with it, and its command line. */
#ifndef KILN_COORDINATOR_BENCH_CHILD_H
#define KILN_COORDINATOR_BENCH_CHILD_H

#include <jansson.h>

#include "coordinator/files/folder.h"
#include "coordinator/job/job.h"

enum { KILN_CHILD_ARGUMENTS = 256, KILN_CHILD_SAID = 8192 };

/* A command line. A failing push is remembered: `status` has it, and kiln_child_run reports it. Start with zeros and
 * `error`; release with kiln_child_clear. */
struct kiln_child {
    char *text[KILN_CHILD_ARGUMENTS];
    size_t count;
    int status;
    struct kiln_error *error;
};

void kiln_child_push(struct kiln_child *child, const char *text);
/* An option and its value, formatted as by printf. */
void kiln_child_push_number(struct kiln_child *child, const char *name, const char *format, double value);
/* Passes on the options that were given to this command and that the child's also has, a bit of enum kiln_command_bit,
 * but those listed in `own`, which ends with NULL. */
void kiln_child_push_given(struct kiln_child *child, const struct kiln_job *job, uint32_t command,
                           const char *const *own);
void kiln_child_clear(struct kiln_child *child);

/* The path of the running program. */
int kiln_child_program(char program[KILN_PATH_SIZE], struct kiln_error *error);

struct kiln_child_end {
    int code;  /* exit code, or KILN_SYSTEM if a signal has ended it */
    int asked; /* the last signal that has asked this process to end, or 0 */
};

/* Runs the command and waits for its end, with stdout and stderr on these descriptors. SIGINT, SIGTERM and SIGHUP are
 * passed on. From a process with one thread. KILN_SITE if it cannot be started. */
int kiln_child_run(struct kiln_child *child, int output, int errors, struct kiln_child_end *end,
                   struct kiln_error *error);

/* Runs the command with its stdout thrown away and its stderr in the file `path`, which is made or emptied. *code is
 * the exit code, and `said` what it wrote to stderr, as much as fits. KILN_OK whatever the code; KILN_STOPPED if a
 * signal asked for the end. */
int kiln_child_run_quietly(struct kiln_child *child, const char *path, int *code, char said[KILN_CHILD_SAID],
                           struct kiln_error *error);

/* The same for a command that prints JSON: its stdout goes to the file `answer`, which is made or emptied, and with
 * code KILN_OK *printed is what it printed; json_decref it. Else *printed is NULL. KILN_BUG if that is no JSON. */
int kiln_child_run_for_json(struct kiln_child *child, const char *answer, const char *path, int *code,
                            char said[KILN_CHILD_SAID], json_t **printed, struct kiln_error *error);

/* The sentence with which a command failed, in what it wrote to stderr; all of that if there is none. */
const char *kiln_child_sentence(const char *said);
/* KILN_OK if `code` is that. Else the failure of the command, which `what` names: its status, and its sentence as the
 * reason. */
int kiln_child_failure(const char *what, int code, const char *said, struct kiln_error *error);

/* The run.json of the bake in `folder`, which a child has just made; json_decref it. KILN_BAD_INPUT. */
int kiln_child_report(const char *folder, json_t **report, struct kiln_error *error);

/* Removes a file, or a folder with all that is in it; follows no link. What cannot be removed stays. */
void kiln_remove_tree(const char *path);

#endif
