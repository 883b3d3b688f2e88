/* A part of the work in a process of its own: this same program, started with other arguments, that gives itself limits
 * and fences (import/child.c, confined/fence.c) before it reads what others wrote. What it has to say comes back as one
 * text on its standard output: the exit status in decimal, a line feed, and a sentence (empty on success). */
#ifndef KILN_COORDINATOR_CONFINED_CONFINED_H
#define KILN_COORDINATOR_CONFINED_CONFINED_H

#include <sys/types.h>

#include "worker/base/stop.h"

enum { KILN_CHILD_OUTPUT = 3 };

struct kiln_confined_call {
    const char *program;          /* path of the kiln program; NULL: the one that runs */
    const char *const *arguments; /* argv, ends with NULL */
    int input;                    /* descriptor that becomes its standard input; -1: /dev/null */
    /* descriptor that becomes its number KILN_CHILD_OUTPUT: what it has to write; below 3: none */
    int output;
    const char *subject; /* the file it reads: begins the sentences on what became of it */
    const char *what;    /* "importer": what it is called in them */
    /* what to do about a file that makes it crash; NULL: "repair it or export it again as glTF" */
    const char *crashed;
    const char *costly;           /* and about one that takes too long; NULL: "simplify the scene" */
    double seconds;               /* of wall clock, after which it is killed */
    const struct kiln_stop *stop; /* borrowed; NULL: none. The child is killed then: KILN_STOPPED */
};

/* Starts the child, waits for it, and passes its status and sentence on. A crash or a limit that was reached is
 * KILN_BAD_INPUT: the file is at fault. Nothing of ours goes along: no other descriptor, no signal mask or handler. Not
 * collective. */
int kiln_confined_run(const struct kiln_confined_call *call, struct kiln_error *error);

/* The parts of it, for who talks with the child in another way. Starts the child with `answer` as its standard output;
 * it is the caller's to wait for. */
int kiln_confined_start(const struct kiln_confined_call *call, int answer, pid_t *pid, struct kiln_error *error);
/* Waits until the child has ended; its state as waitpid gives it. */
int kiln_confined_wait(pid_t pid);
/* The sentence on a child that ended in this state without an answer, and on one that took longer than `seconds`.
 * KILN_BAD_INPUT. */
int kiln_confined_died(const struct kiln_confined_call *call, int state, struct kiln_error *error);
int kiln_confined_late(const struct kiln_confined_call *call, struct kiln_error *error);

#endif
