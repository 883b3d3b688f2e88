/* Thread limits: checks early that the process may start the threads it will need, and reports uncaught C++ exceptions.
 * A library that runs out of threads later would end the process without a message. */
#ifndef KILN_COORDINATOR_RUN_THREADS_H
#define KILN_COORDINATOR_RUN_THREADS_H

#include <stdint.h>

#include "worker/base/status.h"

/* Starts `count` threads and ends them again. KILN_SYSTEM if a limit of processes or memory does not allow them. */
int kiln_threads_check(uint32_t count, struct kiln_error *error);

/* Installs `say` as the handler of uncaught C++ exceptions. Libraries throw such exceptions when they get no memory or
 * no thread. The handler is called with the exception's message and must not return. */
void kiln_on_uncaught(void (*say)(const char *what));

#endif
