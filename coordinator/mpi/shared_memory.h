/* A piece of memory that one process makes and others of the same host, of the same user, map. It has no name in any
 * folder (memfd_create), so neither /dev/shm nor its size matters, and nothing is left of it however the processes end.
 * All of its pages are there from the beginning: who writes to it later is not killed because there is no memory.
 *
 * The others open it through /proc, which shows a process's descriptors to its user, and look at what they opened:
 * another process's file of that number is not taken for it. Where that is not possible (containers that hide processes
 * from each other) opening fails. */
#ifndef KILN_COORDINATOR_MPI_SHARED_MEMORY_H
#define KILN_COORDINATOR_MPI_SHARED_MEMORY_H

#include <stdint.h>

#include "worker/base/status.h"

/* How another process finds it; may be sent as bytes. */
struct kiln_shared_key {
    int64_t process, descriptor;
    uint64_t device, inode, bytes;
};

/* Makes zeroed memory of `bytes` (not 0), mapped at *memory, whose pages are next to this process's processor. The key
 * holds until kiln_shared_seal. KILN_SYSTEM, with nothing made and a key of all zeros, when there is none. Release with
 * kiln_shared_release. */
int kiln_shared_make(void **memory, struct kiln_shared_key *key, uint64_t bytes, struct kiln_error *error);
/* All have opened it: from here on nobody else can. */
void kiln_shared_seal(struct kiln_shared_key *key);
/* Maps what another process made. KILN_SYSTEM when this one cannot. Release with kiln_shared_release. */
int kiln_shared_open(void **memory, const struct kiln_shared_key *key, struct kiln_error *error);
/* *memory may be NULL, and is after. */
void kiln_shared_release(void **memory, uint64_t bytes);

#endif
