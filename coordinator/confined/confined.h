/* Runs work on untrusted files in a confined child process. The child is this same program, started with other
 * arguments; it limits and sandboxes itself (import/child.c, confined/fence.c) before it reads anything. It answers
 * with one text on its standard output: the exit status in decimal, a line feed, and a sentence (empty on success). */
#ifndef KILN_COORDINATOR_CONFINED_CONFINED_H
#define KILN_COORDINATOR_CONFINED_CONFINED_H

#include <sys/types.h>

#include "worker/base/stop.h"

enum { KILN_CHILD_OUTPUT = 3 };

struct kiln_confined_call {
    const char *program;          /* path of the kiln program; NULL: the running one */
    const char *const *arguments; /* argv, NULL-terminated */
    int input;                    /* descriptor that becomes the child's standard input; -1: /dev/null */
    /* descriptor that becomes the child's descriptor KILN_CHILD_OUTPUT, for its result; below 3: none */
    int output;
    const char *subject; /* the file that the child reads; begins sentences about its end */
    const char *what;    /* the child's name in these sentences, such as "importer" */
    /* the remedy for a file that makes the child crash; NULL: "repair it or export it again as glTF" */
    const char *crashed;
    const char *costly; /* the remedy for a file that takes too long; NULL: "simplify the scene" */
    double seconds;     /* wall-clock time, s, after which the child is killed */
    /* borrowed; NULL: none. When asked, the child is killed and the result is KILN_STOPPED */
    const struct kiln_stop *stop;
};

/* Starts the child, waits for it, and returns its status and sentence. A crash or a limit that was reached is
 * KILN_BAD_INPUT: the file is at fault. Other ends: kiln_confined_died. The child inherits nothing else: no other
 * descriptor, no signal mask, no signal handler. Not collective. */
int kiln_confined_run(const struct kiln_confined_call *call, struct kiln_error *error);

/* The steps of kiln_confined_run, for callers that talk with the child in another way. Starts the child with `answer`
 * as its standard output; the caller must wait for it. */
int kiln_confined_start(const struct kiln_confined_call *call, int answer, pid_t *pid, struct kiln_error *error);
/* Waits until the child has ended. Returns its state as waitpid gives it. */
int kiln_confined_wait(pid_t pid);
/* Write the error message and return the status for a child that ended in `state` without an answer, and for one that
 * took longer than `seconds`. A signal sent to the child is not the file's fault: KILN_SYSTEM for SIGKILL, which the
 * kernel sends if memory is short, KILN_STOPPED for the others. A file size limit is KILN_IO. All else is
 * KILN_BAD_INPUT. */
int kiln_confined_died(const struct kiln_confined_call *call, int state, struct kiln_error *error);
int kiln_confined_late(const struct kiln_confined_call *call, struct kiln_error *error);

#endif
