/* DIR/.kiln.lock: one bake at a time in a folder, from before anything is written there until after everything is.
 *
 * The file says who holds it, as one JSON object: host, boot, process, started, since, command, locks. It is written
 * aside and linked to its name, so it is never seen half. The holder has a lock of its open file description on it
 * (fcntl, F_OFD_SETLK: it ends with the process, whatever ends that, and goes over NFS and Lustre); who gets a write
 * lock on a file that is there may replace it. What a killed bake left is thus taken over at once.
 *
 * Where the file system has no locks, the file itself is the lock, as a lease: its holder has the file server set its
 * time once a second (kiln_lock_beat), and another may take it over when it has stood still for 15 s while it was
 * looked at, or 3 s when its process is not among those of this host. The same is looked at for 3 s where the lock was
 * free but another host's name is in it: some mounts have locks that other hosts do not see. A holder that stood still
 * for longer itself finds out by kiln_lock_check.
 *
 * KILN_LOCKS=none in the environment, for tests: as where there are no locks.
 *
 * For one rank; nothing here is collective. */
#ifndef KILN_COORDINATOR_RUN_LOCK_H
#define KILN_COORDINATOR_RUN_LOCK_H

#include "worker/base/status.h"

struct kiln_lock;

/* KILN_CANNOT_CREATE with the holder when another has it; KILN_NO_INPUT when there is no such folder. */
int kiln_lock_take(struct kiln_lock **lock, const char *directory, struct kiln_error *error);
/* Removes the file. NULL is fine. */
void kiln_lock_release(struct kiln_lock **lock);

/* To be called once a second or so, by one thread. */
void kiln_lock_beat(const struct kiln_lock *lock);
/* KILN_IO when another has taken the folder over: before results are replaced. */
int kiln_lock_check(const struct kiln_lock *lock, struct kiln_error *error);

/* For what writes beside the results of a bake: KILN_CANNOT_CREATE when one is at work in `directory`. Nothing is
 * written. */
int kiln_lock_refuse(const char *directory, struct kiln_error *error);

#endif
