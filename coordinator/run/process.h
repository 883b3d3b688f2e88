/* Process set-up: standard descriptors, resource limits and signals. */
#ifndef KILN_COORDINATOR_RUN_PROCESS_H
#define KILN_COORDINATOR_RUN_PROCESS_H

#include <signal.h>
#include <stdbool.h>

#include "worker/base/status.h"

/* Call it first, also in child processes. Each of the descriptors 0 to 2 that is closed is opened on /dev/null, so that
 * no file or pipe gets its number and then the text that is meant for a terminal. /dev/null is opened in the wrong
 * direction for that descriptor, so that using it still fails. SIGXFSZ is ignored, so that a file beyond the size limit
 * (ulimit -f) gives EFBIG, which kiln can report. Blocks of 32 MiB and more go back to the system when they are freed,
 * whatever was freed before; smaller ones stay with the process. */
void kiln_process_begin(void);

/* Makes sure that the stack of this thread, and of threads that are started later, may have 4 MiB: a set of fields with
 * thousands of groups of lights has 0.5 MiB, and some functions have several. KILN_SYSTEM, with both sizes, if the hard
 * limit (ulimit -Hs) is lower. */
int kiln_process_need_stack(struct kiln_error *error);

/* Every kiln that this process starts from now on is killed when this process dies, however that happens, so that the
 * same command can be given again at once. Sets KILN_ENDS_WITH in the environment, for kiln_process_begin there. */
void kiln_process_take_along(void);

/* Gives memory that has been freed back to the system, so that the process' memory is what is in use. */
void kiln_process_give_back(void);

/* From this call on SIGINT, SIGTERM, SIGUSR1 and SIGHUP are recorded, for code that can stop early. A second SIGINT
 * ends the process at once; no incomplete file remains, since files get their names when they are complete, and
 * temporary ones are removed (files/left_behind.h). SIGHUP stays ignored if it was (nohup). SIGPIPE is ignored, since
 * the reader of the progress output may end. Before this call the signals end the process, which loses nothing. */
void kiln_process_catch(void);
/* For commands that write files and have nothing to save. From this call on the same signals end the process at once
 * with KILN_STOPPED, after its temporary files have been removed. `speaks`: it says so first, on stderr, and with
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
