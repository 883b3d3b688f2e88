/* The sandbox of a confined child, which it applies to itself: resource limits that grow with its input, and a seccomp
 * filter that allows only system calls on memory and on descriptors it already has. Where the kernel or a sanitizer
 * does not allow the filter, the reader's own checks are the only protection. Not thread-safe. */
#ifndef KILN_COORDINATOR_CONFINED_FENCE_H
#define KILN_COORDINATOR_CONFINED_FENCE_H

#include <stdint.h>

/* Sets a soft limit (RLIMIT_...) of this process, as far as the hard limit allows. */
void kiln_fence_limit(int resource, uint64_t value);

/* Makes the process die with its parent and write no core files. Call it first. */
void kiln_fence_begin(void);

/* From now on the process may use `bytes` more of private memory than it has now, and `seconds` more of CPU time than
 * it has used; beyond that, SIGXCPU ends it. Each call replaces the limits of the one before. */
void kiln_fence_limits(uint64_t bytes, uint64_t seconds);

/* Installs the seccomp filter: no thread can open, remove, start or connect to anything any more; such calls fail with
 * EPERM. The process may still start threads. */
void kiln_fence_calls(void);

#endif
