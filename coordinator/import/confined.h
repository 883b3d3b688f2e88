/* A part of the work in a process of its own: this same program, started with other arguments, that gives itself limits and fences
 * (child.c) before it reads what others wrote. What it has to say comes back as one text on its standard output: the exit status in
 * decimal, a line feed, and a sentence (empty on success). */
#ifndef KILN_COORDINATOR_IMPORT_CONFINED_H
#define KILN_COORDINATOR_IMPORT_CONFINED_H

#include "worker/base/stop.h"

struct kiln_confined_call {
    const char *program;          /* path of the kiln program; NULL: the one that runs */
    const char *const *arguments; /* argv, ends with NULL */
    int input;                    /* descriptor that becomes its standard input; -1: /dev/null */
    const char *subject;          /* the file it reads: begins the sentences on what became of it */
    const char *what;             /* "importer": what it is called in them */
    double seconds;               /* of wall clock, after which it is killed */
    const struct kiln_stop *stop; /* borrowed; NULL: none. The child is killed then: KILN_STOPPED */
};

/* Starts the child, waits for it, and passes its status and sentence on. A crash or a limit that was reached is KILN_BAD_INPUT: the file
 * is at fault. Nothing of ours goes along: no descriptor, no signal mask or handler. Not collective. */
int kiln_confined_run(const struct kiln_confined_call *call, struct kiln_error *error);

#endif
