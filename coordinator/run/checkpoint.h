/* What a bake keeps of itself, so that it can go on after anything that ends it.
 *
 *   DIR/checkpoint/gen-000012/part-00000   arrays of rank 0, one after the other
 *                             part-00001   ...
 *                             manifest     JSON, sealed (coordinator/files/checksummed_json.h)
 *
 * A generation is written into a folder called .writing-000012: one file a rank, synced; then by rank 0 the manifest,
 * which says for each file its size, its XXH3 hash and where in it which array lies; then the folder gets its name and
 * the one above is synced. So a folder called gen-* is whole, whenever and however the writers died; a folder called
 * .writing-* is worth nothing and swept away by the next bake. The two newest generations are kept: one that fails its
 * hashes is passed over, with a sentence, for the one before.
 *
 * Arrays have a name and a range: `first` and `count` in some global numbering, such as that of surface points. A
 * reader asks for a range and gets it from whatever files hold it, so the number of ranks that read need not be that
 * which wrote. Values are as the processor has them; the manifest says which byte order that is. */
#ifndef KILN_COORDINATOR_RUN_CHECKPOINT_H
#define KILN_COORDINATOR_RUN_CHECKPOINT_H

#include <jansson.h>
#include <mpi.h>
#include <stdbool.h>
#include <stdint.h>

#include "worker/base/status.h"

enum { KILN_BLOCK_NAME = 24, KILN_BLOCKS_MAX = 48 };

/* An array of one rank, or a part of one that ranks share. */
struct kiln_block {
    char name[KILN_BLOCK_NAME];
    uint64_t first, count; /* elements */
    uint64_t size;         /* bytes of an element */
    const void *data;      /* borrowed during the call */
};

struct kiln_checkpoint;

/* Collective. The generations of the bake folder `directory`, which is there; nothing is written, and left-overs of
 * writers that died are removed. With `take` the newest generation that is whole is opened: every file is read once and
 * compared with its hash, by one of the ranks. Generations that are not whole are named on stderr (rank 0), passed
 * over, and removed once a whole one is found. Destroy with kiln_checkpoint_close. */
int kiln_checkpoint_open(struct kiln_checkpoint **checkpoint, MPI_Comm communicator, const char *directory, bool take,
                         struct kiln_error *error);
void kiln_checkpoint_close(struct kiln_checkpoint **checkpoint);

/* The number of the open generation; 0: there is none. */
uint64_t kiln_checkpoint_generation(const struct kiln_checkpoint *checkpoint);
/* What the writer gave as `identity`: borrowed, NULL without an open generation. */
const json_t *kiln_checkpoint_identity(const struct kiln_checkpoint *checkpoint);
/* Seconds since 1970 at which it was written. */
double kiln_checkpoint_written(const struct kiln_checkpoint *checkpoint);

/* Collective. Writes a new generation of this rank's `blocks` and removes the one before the last. `identity` is
 * borrowed, and the same on all ranks. The folder is made when it is missing. Free space is looked at first: KILN_IO
 * with both numbers unless 1.2 times what is to be written is there; when an older generation's room makes the
 * difference, it goes first, so that one is always whole. KILN_IO, KILN_CANNOT_CREATE, KILN_PERMISSION: the generations
 * before are as they were. */
int kiln_checkpoint_write(struct kiln_checkpoint *checkpoint, const json_t *identity, const struct kiln_block *blocks,
                          size_t block_count, struct kiln_error *error);
/* The number of the last one written or opened. */
uint64_t kiln_checkpoint_last(const struct kiln_checkpoint *checkpoint);
/* How many have been written, the seconds that took this rank, and the bytes of the last (all ranks). */
void kiln_checkpoint_spent(const struct kiln_checkpoint *checkpoint, uint64_t *count, double *seconds, uint64_t *bytes);

/* Elements [first, first + count) of the array called `name`, from the open generation. Not collective. KILN_IO when it
 * does not hold all of them, with elements of `size` bytes. */
int kiln_checkpoint_read(const struct kiln_checkpoint *checkpoint, const char *name, uint64_t first, uint64_t count,
                         size_t size, void *values, struct kiln_error *error);
/* Whether the open generation has an array of that name. */
bool kiln_checkpoint_has(const struct kiln_checkpoint *checkpoint, const char *name);

/* The files of the open generation, one a rank that wrote. */
size_t kiln_checkpoint_parts(const struct kiln_checkpoint *checkpoint);
/* The range that file `part` has of the array; count 0: nothing. */
void kiln_checkpoint_part_range(const struct kiln_checkpoint *checkpoint, size_t part, const char *name,
                                uint64_t *first, uint64_t *count);
/* All of the array that file `part` has: *values is from kiln_allocate, *count elements. Not collective. */
int kiln_checkpoint_read_part(const struct kiln_checkpoint *checkpoint, size_t part, const char *name, size_t size,
                              void *values, uint64_t *count, struct kiln_error *error);

/* Collective. Removes all generations, and the folder when nothing else is in it. Nothing there is fine, and what
 * cannot be removed stays. */
void kiln_checkpoint_remove(struct kiln_checkpoint *checkpoint);

/* Rank 0 only: removes DIR/checkpoint, if it is empty. */
void kiln_checkpoint_remove_folder(const char *directory);

/* Rank 0 only, without MPI: whether there is a generation's folder in the bake folder, and the newest one's number. For
 * `kiln status`. */
bool kiln_checkpoint_newest(const char *directory, uint64_t *generation);

#endif
