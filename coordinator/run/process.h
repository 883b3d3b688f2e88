/* What a process of kiln makes of its surroundings before it does anything: descriptors, limits, signals. */
#ifndef KILN_COORDINATOR_RUN_PROCESS_H
#define KILN_COORDINATOR_RUN_PROCESS_H

#include <signal.h>
#include <stdbool.h>

/* First of all, also in children. A descriptor 0 to 2 that is closed is taken by a place without bytes to read, which
 * cannot be written to either: else the next file or pipe that is opened would get its number, and the text that is
 * meant for a terminal. A file that outgrows the size limit (ulimit -f) gives EFBIG, which is said, instead of SIGXFSZ,
 * which kills without a word. */
void kiln_process_begin(void);

/* From here on SIGINT, SIGTERM, SIGUSR1 and SIGHUP are noted, for who is able to stop halfway; a second SIGINT ends the
 * process at once: files only get their names when they are complete. SIGHUP stays ignored where it was (nohup).
 * SIGPIPE is ignored: who reads the progress may go. Between the program's start and this call they end the process,
 * and nothing is lost. */
void kiln_process_catch(void);
/* The number of the last one noted; 0: none. */
const volatile sig_atomic_t *kiln_process_signal(void);
/* They end the process again, but for SIGUSR1: a warning of the queue that comes when all is done already must not make
 * a finished bake look like a lost rank. */
void kiln_process_release(void);

#endif
