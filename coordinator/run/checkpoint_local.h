/* Checkpoints on local disks of the nodes (--checkpoint-local), copied to the bake's folder in the background.
 *
 *   LOCAL/kiln-KEY/rank-00000/checkpoint/gen-000012/part-00000   as in the bake's folder (checkpoint.h), but for each
 *                                                   manifest     rank a folder of its own
 *   DIR/checkpoint/local                                         KEY: 32 random digits, unique to this bake
 *
 * A generation is written once all ranks have their part and the manifest on their disks; then the bake continues. A
 * low-priority thread of each rank copies the part into DIR/checkpoint/.writing-000012. Once all parts are there, the
 * thread of rank 0 publishes the generation. So DIR always has a complete generation, the newest or the one before, and
 * a bake can continue without any of the nodes it ran on. The next generation waits until this one is copied. */
#ifndef KILN_COORDINATOR_RUN_CHECKPOINT_LOCAL_H
#define KILN_COORDINATOR_RUN_CHECKPOINT_LOCAL_H

#include "coordinator/run/checkpoint.h"

/* Collective; to be called before kiln_checkpoint_open. Copies the newest complete generation from the disks of these
 * nodes into the bake folder `directory`, unless the folder has one as new. Each part is copied by a rank of the node
 * that has it. If a part is on none of these nodes, nothing changes: the bake continues from the newest generation in
 * `directory`. */
int kiln_checkpoint_bring_home(MPI_Comm communicator, const char *directory, const char *local,
                               struct kiln_error *error);

/* Collective. Makes later generations be written to `local`, which must be a writable folder on each node: otherwise
 * KILN_CANNOT_CREATE or KILN_PERMISSION, with rank and host. */
int kiln_checkpoint_write_locally(struct kiln_checkpoint *checkpoint, const char *local, struct kiln_error *error);

/* Collective. Waits until the last generation is copied to the bake's folder; rank 0 prints a warning if the copy
 * failed. Does nothing without --checkpoint-local. */
void kiln_checkpoint_settle(struct kiln_checkpoint *checkpoint);

#endif
