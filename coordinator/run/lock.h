/* Lock of a bake's folder, DIR/.kiln.lock: only one bake at a time may write there. A bake holds it from before its
 * first write until after its last.
 *
 * The file describes its holder as one JSON object: host, boot, process, started, since, command, locks. It is written
 * under a temporary name and linked to its final one, so no reader sees an incomplete file. The holder keeps an open
 * file description lock on it (fcntl with F_OFD_SETLK), which works over NFS and Lustre and ends with the process,
 * however that ends. A process that gets a write lock on an existing file may replace it, so the lock of a killed bake
 * is taken over at once.
 *
 * On a file system without locks the file is a lease. Its holder renews it by having the file server set its
 * modification time once a second (kiln_lock_beat). Another process may take it over after watching it unchanged for 15
 * s, or for 3 s if the holder's process does not exist on this host. It is also watched for 3 s if the lock is free but
 * the file names another host, since the locks of some mounts are invisible to other hosts. A holder that was suspended
 * for longer finds out with kiln_lock_check.
 *
 * For one rank; nothing here is collective. */
#ifndef KILN_COORDINATOR_RUN_LOCK_H
#define KILN_COORDINATOR_RUN_LOCK_H

#include <stdbool.h>

#include "worker/base/status.h"

struct kiln_lock;

/* Takes the lock. KILN_CANNOT_CREATE if another bake holds it, with a message that describes the holder; KILN_NO_INPUT
 * if there is no such folder. `no_locks`, for tests: the file system counts as one without locks. Release with
 * kiln_lock_release. */
int kiln_lock_take(struct kiln_lock **lock, const char *directory, bool no_locks, struct kiln_error *error);
/* Removes the file. *lock may be NULL. */
void kiln_lock_release(struct kiln_lock **lock);

/* Renews the lease. To be called about once a second, by one thread. */
void kiln_lock_beat(const struct kiln_lock *lock);
/* KILN_IO if another bake has taken the folder over. To be called before results are replaced. */
int kiln_lock_check(const struct kiln_lock *lock, struct kiln_error *error);

/* Checks that no bake is running in `directory`, for commands that write next to its results; otherwise
 * KILN_CANNOT_CREATE. Writes nothing. */
int kiln_lock_refuse(const char *directory, struct kiln_error *error);

#endif
