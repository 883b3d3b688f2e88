/* Process set-up: standard descriptors, resource limits and signals. */
#ifndef KILN_COORDINATOR_RUN_PROCESS_H
#define KILN_COORDINATOR_RUN_PROCESS_H

#include <signal.h>
#include <stdbool.h>

#include "worker/base/status.h"

/* Sets up the process; call it first, also in child processes. Opens closed descriptors among 0 to 2 on /dev/null;
 * otherwise a file or pipe could get such a number and receive text meant for the terminal. /dev/null is opened in the
 * wrong direction, so that using the descriptor still fails. Ignores SIGXFSZ, so that a file beyond the size limit
 * (ulimit -f) gives EFBIG, which kiln can report. Freed blocks of 32 MiB and more always return to the system; smaller
 * ones stay with the process. */
void kiln_process_begin(void);

/* Raises the stack limit of this thread and of later threads to at least 4 MiB. A field set with thousands of light
 * groups takes 0.5 MiB, and some functions have several. KILN_SYSTEM, with both sizes, if the hard limit (ulimit -Hs)
 * is lower. */
int kiln_process_need_stack(struct kiln_error *error);

/* Makes later child processes that run kiln die with this process, in whatever way it dies, so that the same command
 * can be run again at once. Sets KILN_ENDS_WITH in the environment, for kiln_process_begin in the child. */
void kiln_process_take_along(void);

/* Returns freed memory to the system, so that the memory of the process is the memory in use. */
void kiln_process_give_back(void);

/* From this call on SIGINT, SIGTERM, SIGUSR1 and SIGHUP are recorded, for code that can stop early. A second SIGINT
 * ends the process at once; no incomplete file remains, since files get their names when they are complete, and
 * temporary ones are removed (files/left_behind.h). SIGHUP stays ignored if it was (nohup). SIGPIPE is ignored, since
 * the reader of the progress output may end. Before this call the signals end the process, which loses nothing. */
void kiln_process_catch(void);
/* Makes the signals of kiln_process_catch end the process at once with KILN_STOPPED, after removing its temporary
 * files; for commands that write files and have nothing to save. `speaks`: prints a message first, on stderr, and with
 * `json` on stdout too. */
void kiln_process_end_cleanly(bool speaks, bool json);
/* The number of the last recorded signal; 0: none. Threads read it with __atomic_load_n. */
const volatile sig_atomic_t *kiln_process_signal(void);
/* "SIGUSR1", ...; "a signal" for one that is not recorded. */
const char *kiln_process_signal_name(int number);
/* From this call on these signals end the process again, except SIGUSR1, which is ignored: a batch system's warning
 * that arrives after the bake has finished must not make it look like a lost rank. */
void kiln_process_release(void);

#endif
