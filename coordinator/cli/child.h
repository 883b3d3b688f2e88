/* Child processes of kiln bench scaling that run kiln, directly or under mpirun: their command lines, and the folder
 * that they write to. */
#ifndef KILN_COORDINATOR_CLI_CHILD_H
#define KILN_COORDINATOR_CLI_CHILD_H

#include "coordinator/files/folder.h"
#include "coordinator/job/job.h"
#include "coordinator/run/output_folder.h"

enum { KILN_CHILD_ARGUMENTS = 256 };

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
/* Adds the options that were given to this command and that the child's command also takes, except those listed in
 * `own`, which ends with NULL. `command`: a bit of enum kiln_command_bit. */
void kiln_child_push_given(struct kiln_child *child, const struct kiln_job *job, uint32_t command,
                           const char *const *own);
void kiln_child_clear(struct kiln_child *child);

/* The path of the running program. */
int kiln_child_program(char program[KILN_PATH_SIZE], struct kiln_error *error);

struct kiln_child_end {
    int code;  /* exit code, or KILN_SYSTEM if a signal has ended it */
    int asked; /* the last signal that has asked this process to end, or 0 */
};

/* Runs the command with stdout and stderr on these descriptors, and waits for its end. Passes on SIGINT, SIGTERM,
 * SIGUSR1 and SIGHUP. If this process dies of another cause, a directly started kiln dies too, but not processes that
 * mpirun has started. Call from a process with one thread. KILN_SITE if the command cannot be started. */
int kiln_child_run(struct kiln_child *child, int output, int errors, struct kiln_child_end *end,
                   struct kiln_error *error);

/* Makes job->output the output folder of `kiln bench NAME`, for that command alone (output_folder.h). */
int kiln_bench_folder_begin(struct kiln_output_folder **folder, const struct kiln_job *job, const char *name,
                            struct kiln_error *error);

#endif
