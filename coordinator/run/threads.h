/* Whether the process may have the threads that it will need: libraries that find out too late end it without a
 * sentence. */
#ifndef KILN_COORDINATOR_RUN_THREADS_H
#define KILN_COORDINATOR_RUN_THREADS_H

#include <stdint.h>

#include "worker/base/status.h"

/* Starts so many, for a moment. KILN_SYSTEM when they cannot be had: limits of processes or memory. */
int kiln_threads_check(uint32_t count, struct kiln_error *error);

/* What C++ libraries throw and nobody catches (no memory, no thread) ends the process through `say`, with the
 * exception's words; it must not return. */
void kiln_on_uncaught(void (*say)(const char *what));

#endif
