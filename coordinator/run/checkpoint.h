/* Checkpoints: the saved state of a bake, from which it can continue after any interruption.
 *
 *   DIR/checkpoint/gen-000012/part-00000   arrays of rank 0, one after the other
 *                             part-00001   ...
 *                             manifest     JSON with a checksum (coordinator/files/checksummed_json.h)
 *
 * Each checkpoint is called a generation. It is written into a folder .writing-000012: each rank writes and syncs one
 * file, then rank 0 writes the manifest, which lists for each file its size, its XXH3 hash, and the position of each
 * array. Then the folder is renamed and its parent synced. So a folder gen-* is complete, whenever and however the
 * writers ended; a folder .writing-* is incomplete, and the next bake removes it. The two newest generations are kept.
 * If one does not match its hashes, a warning is printed and the previous one is used.
 *
 * Arrays have a name and a range, `first` and `count` in a global numbering such as that of surface points. A reader
 * asks for a range, which is read from whichever files contain it; so the number of ranks that read may differ from the
 * number that wrote. Values have the byte order of the processor, which the manifest states. */
#ifndef KILN_COORDINATOR_RUN_CHECKPOINT_H
#define KILN_COORDINATOR_RUN_CHECKPOINT_H

#include <jansson.h>
#include <mpi.h>
#include <stdbool.h>
#include <stdint.h>

#include "worker/base/status.h"

enum { KILN_ARRAY_NAME = 24, KILN_ARRAYS_MAX = 9728 };

/* A range of an array, as one rank holds it. */
struct kiln_array_range {
    char name[KILN_ARRAY_NAME];
    uint64_t first, count; /* range of elements */
    uint64_t size;         /* bytes of an element */
    const void *data;      /* borrowed during the call */
};

struct kiln_checkpoint;

/* Collective. Opens the checkpoints of the bake folder `directory`, which must exist. Writes nothing, but removes the
 * incomplete files of killed writers. With `take` it opens the newest complete generation: one rank reads each file and
 * compares it with its hash. Rank 0 prints a warning for damaged generations; they are skipped, and removed when a
 * complete one is found. Destroy with kiln_checkpoint_close. */
int kiln_checkpoint_open(struct kiln_checkpoint **checkpoint, MPI_Comm communicator, const char *directory, bool take,
                         struct kiln_error *error);
void kiln_checkpoint_close(struct kiln_checkpoint **checkpoint);

/* Number of the open generation; 0: none is open. */
uint64_t kiln_checkpoint_generation(const struct kiln_checkpoint *checkpoint);
/* The `identity` with which the open generation was written: borrowed; NULL if none is open. */
const json_t *kiln_checkpoint_identity(const struct kiln_checkpoint *checkpoint);
/* Time at which the open generation was written, seconds since 1970. */
double kiln_checkpoint_written(const struct kiln_checkpoint *checkpoint);

/* Collective. Writes a new generation from the `blocks` of all ranks, and removes all but the two newest. `identity` is
 * borrowed, and must be the same on all ranks. The folder is created if it is missing. Checks the free space first:
 * KILN_IO, with both numbers, unless 1.2 times the size of the checkpoint is free. If the space of the older generation
 * suffices, that is removed first, so that one complete generation always exists. After KILN_IO, KILN_CANNOT_CREATE and
 * KILN_PERMISSION the existing generations are unchanged. */
int kiln_checkpoint_write(struct kiln_checkpoint *checkpoint, const json_t *identity,
                          const struct kiln_array_range *blocks, size_t array_count, struct kiln_error *error);
/* Number of the last generation that was written or opened. */
uint64_t kiln_checkpoint_last(const struct kiln_checkpoint *checkpoint);
/* Cost of checkpoints: the number of generations written, the seconds of writing on this rank, and the bytes of the
 * last one on all ranks. */
void kiln_checkpoint_spent(const struct kiln_checkpoint *checkpoint, uint64_t *count, double *seconds, uint64_t *bytes);

/* Not collective. Reads elements [first, first + count) of the array `name` from the open generation. KILN_IO if it
 * does not contain all of them, or its elements do not have `size` bytes. */
int kiln_checkpoint_read(const struct kiln_checkpoint *checkpoint, const char *name, uint64_t first, uint64_t count,
                         size_t size, void *values, struct kiln_error *error);
/* Tells whether the open generation has an array called `name`. */
bool kiln_checkpoint_has(const struct kiln_checkpoint *checkpoint, const char *name);

/* Number of files of the open generation, one for each rank that wrote it. */
size_t kiln_checkpoint_files(const struct kiln_checkpoint *checkpoint);
/* The range of the array that file `part` contains; *count 0: none. */
void kiln_checkpoint_file_range(const struct kiln_checkpoint *checkpoint, size_t part, const char *name,
                                uint64_t *first, uint64_t *count);
/* Not collective. Reads all elements of the array that file `part` contains; *values is from kiln_allocate. */
int kiln_checkpoint_read_file(const struct kiln_checkpoint *checkpoint, size_t part, const char *name, size_t size,
                              void *values, uint64_t *count, struct kiln_error *error);

/* Collective. Removes all generations, and the folder if nothing else is in it. Ignores failures. */
void kiln_checkpoint_remove(struct kiln_checkpoint *checkpoint);

/* Rank 0 only: removes DIR/checkpoint if it is empty. */
void kiln_checkpoint_remove_folder(const char *directory);

/* Finds the number of the newest generation in the bake folder; false if there is none. Without MPI, for `kiln status`.
 */
bool kiln_checkpoint_newest(const char *directory, uint64_t *generation);

#endif
