/* Thread limits: checks early that the process may start the threads it will need, and reports C++ exceptions that
 * nobody catches. Libraries that run out of threads later end the process without a message. */
#ifndef KILN_COORDINATOR_RUN_THREADS_H
#define KILN_COORDINATOR_RUN_THREADS_H

#include <stdint.h>

#include "worker/base/status.h"

/* Starts `count` threads and ends them again. KILN_SYSTEM if a limit of processes or memory does not allow them. */
int kiln_threads_check(uint32_t count, struct kiln_error *error);

/* Installs `say` as the handler of C++ exceptions that nobody catches, as libraries throw them when they get no memory
 * or no thread. It is called with the exception's message and must not return. */
void kiln_on_uncaught(void (*say)(const char *what));

#endif
