/* Private parts of checkpoints: shared by checkpoint.c (reading), checkpoint_write.c and checkpoint_folder.c. */
#ifndef KILN_COORDINATOR_RUN_CHECKPOINT_PRIVATE_H
#define KILN_COORDINATOR_RUN_CHECKPOINT_PRIVATE_H

#include "coordinator/run/checkpoint.h"
#include "coordinator/files/publish.h"
#include "coordinator/files/checksummed_json.h"

/* Version of the format, of the manifest and of all records in arrays. It is checked before anything else is read, and
 * a checkpoint of another version is refused. */
enum { KILN_CHECKPOINT_FORMAT = 11, CHECKPOINT_NAME = 96 };

/* Position of an array in a file. */
struct checkpoint_array {
    char name[KILN_ARRAY_NAME];
    uint64_t first, count, size, offset;
};

/* A file of the generation being written. */
struct checkpoint_file {
    uint64_t bytes;
    char hash[KILN_HASH_TEXT];
    uint32_t array_count;
    struct checkpoint_array blocks[KILN_ARRAYS_MAX];
};

/* A file of the open generation. Its blocks are `array_count` blocks of the checkpoint from index `first_array` on. */
struct checkpoint_entry {
    uint64_t bytes;
    char hash[KILN_HASH_TEXT];
    uint32_t array_count;
    size_t first_array;
};

/* File in a bake's folder that holds the key of its checkpoints on disks of nodes (checkpoint_local.h). */
#define CHECKPOINT_KEY_FILE "checkpoint/local"

struct checkpoint_local;

struct kiln_checkpoint {
    MPI_Comm communicator;
    int rank, ranks;
    char directory[KILN_PATH_SIZE]; /* folder of the bake */
    char place[KILN_PATH_SIZE];     /* where generations are written: `directory`, or the rank's folder on its node */
    struct checkpoint_local *local; /* checkpoint_local.c; NULL: generations are written to `directory` */
    /* the open generation */
    uint64_t generation;
    json_t *manifest;
    struct checkpoint_entry *parts;
    size_t part_count;
    struct checkpoint_array *blocks; /* of all parts */
    char path[KILN_PATH_SIZE];       /* path of its folder, for messages */
    /* writing */
    uint64_t newest; /* highest number of any generation so far */
    uint64_t written, last_bytes;
    double seconds;
};

/* Opens DIR/checkpoint/gen-N or, with `writing`, DIR/checkpoint/.writing-N (folder.h). */
int checkpoint_open_generation(struct kiln_folder *folder, const char *directory, bool writing, uint64_t generation,
                               bool make, struct kiln_error *error);
/* Names of a generation's files, relative to DIR. */
void checkpoint_file_name(char name[CHECKPOINT_NAME], bool writing, uint64_t generation, size_t part);
void checkpoint_manifest_name(char name[CHECKPOINT_NAME], bool writing, uint64_t generation);

/* Rank 0: lists the generations of the bake folder, newest first, or with `writing` the incomplete ones. *generations
 * is from kiln_allocate. Without a checkpoint there are none. */
int checkpoint_list(const char *directory, bool writing, uint64_t **generations, size_t *count,
                    struct kiln_error *error);
/* Rank 0: removes a generation: first its files, then its folder; if that is a link, only the link. */
void checkpoint_remove_generation(const char *directory, bool writing, uint64_t generation);
/* Rank 0: renames an incomplete generation to its final name, and syncs. */
int checkpoint_publish_generation(const char *directory, uint64_t generation, struct kiln_error *error);

/* ---- checkpoint_write.c ---- */

/* Makes sure that 1.2 x `bytes` are free at `place`, if necessary by removing the older of two generations, and creates
 * the empty folder of a generation there. `first`: nothing has been written there yet. */
int checkpoint_begin(const char *place, bool first, uint64_t bytes, uint64_t generation, struct kiln_error *error);
/* Writes the manifest, renames the generation to its final name and removes all but the two newest. */
int checkpoint_publish(const char *place, uint64_t generation, const char *manifest, size_t size,
                       struct kiln_error *error);

/* ---- checkpoint_local.c; all need c->local ---- */

/* Collective, before a generation is written: makes c->place. */
int checkpoint_local_begin(struct kiln_checkpoint *c, struct kiln_error *error);
/* Collective. Begins to copy a generation that is complete on the nodes; `bytes`: its size on all ranks. */
void checkpoint_local_copy(struct kiln_checkpoint *c, uint64_t generation, uint64_t bytes, const char *manifest,
                           size_t size);
/* Collective. Removes all that this bake has on the nodes. */
void checkpoint_local_remove(struct kiln_checkpoint *c);
/* Ends copying, even if it is incomplete. Not collective. */
void checkpoint_local_close(struct kiln_checkpoint *c);

#endif
