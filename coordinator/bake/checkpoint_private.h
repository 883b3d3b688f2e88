/* Shared by checkpoint.c (reading), checkpoint_write.c and checkpoint_folder.c. */
#ifndef KILN_COORDINATOR_BAKE_CHECKPOINT_PRIVATE_H
#define KILN_COORDINATOR_BAKE_CHECKPOINT_PRIVATE_H

#include "coordinator/bake/checkpoint.h"
#include "coordinator/output/publish.h"
#include "coordinator/output/sealed.h"

enum { KILN_CHECKPOINT_FORMAT = 2 };

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
    char folder[KILN_PATH_SIZE]; /* DIR/checkpoint */
    /* the open generation */
    uint64_t generation;
    json_t *manifest;
    struct checkpoint_part *parts;
    size_t part_count;
    char path[KILN_PATH_SIZE]; /* its folder */
    /* writing */
    uint64_t newest;             /* the highest number there is or was */
    uint64_t written, last_bytes;
    double seconds;
};

/* FOLDER/gen-N, or FOLDER/.writing-N */
int checkpoint_generation_path(char path[KILN_PATH_SIZE], const char *folder, bool writing, uint64_t generation, struct kiln_error *error);
int checkpoint_part_path(char path[KILN_PATH_SIZE], const char *generation, size_t part, struct kiln_error *error);

/* Rank 0: the generations in `folder`, newest first; *generations is from kiln_allocate. A folder that is not there has none.
 * With `writing` the unfinished ones. */
int checkpoint_list(const char *folder, bool writing, uint64_t **generations, size_t *count, struct kiln_error *error);
/* Rank 0: removes one, that is, the files that a generation has and then the folder. */
void checkpoint_remove_generation(const char *folder, bool writing, uint64_t generation);
/* Rank 0: syncs a folder. */
int checkpoint_sync_folder(const char *path, struct kiln_error *error);

#endif
