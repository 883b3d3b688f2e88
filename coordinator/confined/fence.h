/* The sandbox of a confined child, which it applies to itself: resource limits that grow with its input, and a seccomp
 * filter that allows only system calls on memory and on descriptors it already has. Where the kernel or a sanitizer
 * does not allow the filter, the reader's own checks are the only protection. Not thread-safe. */
#ifndef KILN_COORDINATOR_CONFINED_FENCE_H
#define KILN_COORDINATOR_CONFINED_FENCE_H

#include <stdint.h>

/* Whether the program has AddressSanitizer, which reserves terabytes and needs files for its reports. */
#if defined(__SANITIZE_ADDRESS__)
#    define KILN_ADDRESS_SANITIZER 1
#elif defined(__has_feature)
#    if __has_feature(address_sanitizer)
#        define KILN_ADDRESS_SANITIZER 1
#    endif
#endif
#ifndef KILN_ADDRESS_SANITIZER
#    define KILN_ADDRESS_SANITIZER 0
#endif

/* Sets a soft limit (RLIMIT_...) of this process, as far as the hard limit allows. */
void kiln_fence_limit(int resource, uint64_t value);

/* Makes the process die with its parent, since nobody would read its answer, and write no core files. To be called
 * first. */
void kiln_fence_begin(void);

/* From now on the process may use `bytes` more of private memory than it has now, and `seconds` more of CPU time than
 * it has used; beyond that, SIGXCPU ends it. Each call replaces the limits of the one before. */
void kiln_fence_limits(uint64_t bytes, uint64_t seconds);

/* Installs the seccomp filter: no thread can open, remove, start or connect to anything any more; such calls fail with
 * EPERM. The process may still start threads. */
void kiln_fence_calls(void);

#endif
