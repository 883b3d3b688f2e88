/* What a confined child does to itself once it is ready to read: limits that follow what it is given, and no system
 * calls but those that work on memory and on descriptors it has been handed. Where the kernel or a sanitizer does not
 * allow that, the checks of who reads stand alone. Not thread-safe. */
#ifndef KILN_COORDINATOR_CONFINED_FENCE_H
#define KILN_COORDINATOR_CONFINED_FENCE_H

#include <stdint.h>

/* Sets a soft limit (RLIMIT_...) of this process, as far as the hard one allows. */
void kiln_fence_limit(int resource, uint64_t value);

/* Dies with its parent; no core files. Call it first. */
void kiln_fence_begin(void);

/* From here on the process may take `bytes` more of private memory than it has now, and `seconds` more of CPU time than
 * it has used: SIGXCPU ends it then. Each call replaces what the one before allowed. */
void kiln_fence_limits(uint64_t bytes, uint64_t seconds);

/* Lets nothing be opened, removed, started or connected to any more, by any thread: such calls fail with EPERM
 * (seccomp). Threads of its own the process may start. */
void kiln_fence_calls(void);

#endif
