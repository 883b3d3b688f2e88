/* Checkpoints on disks of the nodes (--checkpoint-local): written there first, and copied to the bake's folder behind.
 *
 *   LOCAL/kiln-KEY/rank-00000/checkpoint/gen-000012/part-00000   as in the bake's folder (checkpoint.h), but for each
 *                                                   manifest     rank a folder of its own
 *   DIR/checkpoint/local                                         KEY: 32 digits by chance, of this bake alone
 *
 * A generation is written once all ranks have their part and the manifest on their disks; then the bake goes on. A
 * thread of each rank, which gives way to the passes, copies the part into DIR/checkpoint/.writing-000012, and rank 0's
 * publishes the generation once all parts are there. So DIR has the newest generation or the one before, whole, and a
 * bake can go on without any of the nodes that it ran on. The next generation waits until this one is copied. */
#ifndef KILN_COORDINATOR_RUN_CHECKPOINT_LOCAL_H
#define KILN_COORDINATOR_RUN_CHECKPOINT_LOCAL_H

#include "coordinator/run/checkpoint.h"

/* Collective, before kiln_checkpoint_open. Copies the newest generation that is whole on the disks of these nodes, each
 * part by a rank of the node that has it, into the bake folder `directory`, if it is newer than those that are there.
 * Where a part is on no node here nothing changes: then the newest in `directory` is the one to go on from. */
int kiln_checkpoint_bring_home(MPI_Comm communicator, const char *directory, const char *local,
                               struct kiln_error *error);

/* Collective. From now on generations are written to `local`, which must be a folder on each node: KILN_CANNOT_CREATE,
 * KILN_PERMISSION, with rank and host, if one has none or nothing can be written there. */
int kiln_checkpoint_write_locally(struct kiln_checkpoint *checkpoint, const char *local, struct kiln_error *error);

/* Collective. Waits until the last generation that was written is copied to the bake's folder; rank 0 prints a warning
 * if it could not be. Without --checkpoint-local nothing. */
void kiln_checkpoint_settle(struct kiln_checkpoint *checkpoint);

#endif
