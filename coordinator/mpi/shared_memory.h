/* Shared memory between processes of the same user on the same host: one process allocates it, others map it. It is an
 * anonymous file (memfd_create), so it does not depend on /dev/shm or its size, and nothing remains of it however the
 * processes end. All its pages are allocated at the beginning, so no process is killed later because memory ran out.
 *
 * Other processes open the file through /proc/PROCESS/fd and check device, inode and size of what they opened, so that
 * a different file with the same descriptor number is refused. Where /proc hides other processes (in some containers),
 * opening fails. */
#ifndef KILN_COORDINATOR_MPI_SHARED_MEMORY_H
#define KILN_COORDINATOR_MPI_SHARED_MEMORY_H

#include <stdint.h>

#include "worker/base/status.h"

/* Key by which another process opens the memory. May be sent as bytes. */
struct kiln_shared_key {
    int64_t process, descriptor;
    uint64_t device, inode, bytes;
};

/* Allocates `bytes` (not 0) of zeroed memory and maps it at *memory; its pages lie in the NUMA domain of the calling
 * process. The key is valid until kiln_shared_seal. KILN_SYSTEM if memory is short: nothing is allocated then, and the
 * key is all zeros. Release with kiln_shared_release. */
int kiln_shared_make(void **memory, struct kiln_shared_key *key, uint64_t bytes, struct kiln_error *error);
/* Closes the descriptor, so that no further process can open the memory. Call it when all have opened it. */
void kiln_shared_seal(struct kiln_shared_key *key);
/* Maps memory that another process allocated. KILN_SYSTEM if that fails. Release with kiln_shared_release. */
int kiln_shared_open(void **memory, const struct kiln_shared_key *key, struct kiln_error *error);
/* Unmaps the memory and sets *memory to NULL. *memory may be NULL. */
void kiln_shared_release(void **memory, uint64_t bytes);

#endif
