/* Shared by checkpoint.c (reading), checkpoint_write.c and checkpoint_folder.c. */
#ifndef KILN_COORDINATOR_RUN_CHECKPOINT_PRIVATE_H
#define KILN_COORDINATOR_RUN_CHECKPOINT_PRIVATE_H

#include "coordinator/run/checkpoint.h"
#include "coordinator/files/publish.h"
#include "coordinator/files/checksummed_json.h"

/* The number of the format, of the manifest and of all records in blocks: it is looked at before anything else is read,
 * and a checkpoint of another number is refused. */
enum { KILN_CHECKPOINT_FORMAT = 3, CHECKPOINT_NAME = 96 };

/* Where an array lies in a file. */
struct checkpoint_block {
    char name[KILN_BLOCK_NAME];
    uint64_t first, count, size, offset;
};

struct checkpoint_part {
    uint64_t bytes;
    char hash[KILN_HASH_TEXT];
    uint32_t block_count;
    struct checkpoint_block blocks[KILN_BLOCKS_MAX];
};

struct kiln_checkpoint {
    MPI_Comm communicator;
    int rank, ranks;
    char directory[KILN_PATH_SIZE]; /* of the bake */
    /* the open generation */
    uint64_t generation;
    json_t *manifest;
    struct checkpoint_part *parts;
    size_t part_count;
    char path[KILN_PATH_SIZE]; /* its folder, for sentences */
    /* writing */
    uint64_t newest; /* the highest number there is or was */
    uint64_t written, last_bytes;
    double seconds;
};

/* DIR/checkpoint/gen-N, or DIR/checkpoint/.writing-N, open (folder.h). */
int checkpoint_open_generation(struct kiln_folder *folder, const char *directory, bool writing, uint64_t generation,
                               bool make, struct kiln_error *error);
/* Names of its files, within DIR. */
void checkpoint_file_name(char name[CHECKPOINT_NAME], bool writing, uint64_t generation, size_t part);
void checkpoint_manifest_name(char name[CHECKPOINT_NAME], bool writing, uint64_t generation);

/* Rank 0: the generations of the bake folder, newest first; *generations is from kiln_allocate. Without a checkpoint
 * there are none. With `writing` the unfinished ones. */
int checkpoint_list(const char *directory, bool writing, uint64_t **generations, size_t *count,
                    struct kiln_error *error);
/* Rank 0: removes one, that is, the files that a generation has and then the folder; of a link, the link. */
void checkpoint_remove_generation(const char *directory, bool writing, uint64_t generation);
/* Rank 0: gives an unfinished one its name, and syncs. */
int checkpoint_publish_generation(const char *directory, uint64_t generation, struct kiln_error *error);

#endif
