/* Private parts of checkpoints: shared by checkpoint.c (reading), checkpoint_write.c and checkpoint_folder.c. */
#ifndef KILN_COORDINATOR_RUN_CHECKPOINT_PRIVATE_H
#define KILN_COORDINATOR_RUN_CHECKPOINT_PRIVATE_H

#include "coordinator/run/checkpoint.h"
#include "coordinator/files/publish.h"
#include "coordinator/files/checksummed_json.h"

/* Version of the format, of the manifest and of all records in blocks. It is checked before anything else is read, and
 * a checkpoint of another version is refused. */
enum { KILN_CHECKPOINT_FORMAT = 10, CHECKPOINT_NAME = 96 };

/* Position of an array in a file. */
struct checkpoint_block {
    char name[KILN_BLOCK_NAME];
    uint64_t first, count, size, offset;
};

/* A file that is written. */
struct checkpoint_part {
    uint64_t bytes;
    char hash[KILN_HASH_TEXT];
    uint32_t block_count;
    struct checkpoint_block blocks[KILN_BLOCKS_MAX];
};

/* A file that is read: its blocks are those of the checkpoint from number `first_block` on. */
struct checkpoint_entry {
    uint64_t bytes;
    char hash[KILN_HASH_TEXT];
    uint32_t block_count;
    size_t first_block;
};

struct kiln_checkpoint {
    MPI_Comm communicator;
    int rank, ranks;
    char directory[KILN_PATH_SIZE]; /* folder of the bake */
    /* the open generation */
    uint64_t generation;
    json_t *manifest;
    struct checkpoint_entry *parts;
    size_t part_count;
    struct checkpoint_block *blocks; /* of all parts */
    char path[KILN_PATH_SIZE];       /* path of its folder, for messages */
    /* writing */
    uint64_t newest; /* highest number of any generation so far */
    uint64_t written, last_bytes;
    double seconds;
};

/* Opens DIR/checkpoint/gen-N or, with `writing`, DIR/checkpoint/.writing-N (folder.h). */
int checkpoint_open_generation(struct kiln_folder *folder, const char *directory, bool writing, uint64_t generation,
                               bool make, struct kiln_error *error);
/* Names of its files, relative to DIR. */
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

#endif
