/* Fields in checkpoints: one block a field, named as the field, elements counted in the field's domain from the first
 * surface point on. Not collective. */
#ifndef KILN_COORDINATOR_FIELD_FIELD_BLOCKS_H
#define KILN_COORDINATOR_FIELD_FIELD_BLOCKS_H

#include "coordinator/field/rank_data.h"
#include "coordinator/run/checkpoint.h"

/* When a checkpoint is written, which settles the fields that are in it. */
struct kiln_save_moment {
    bool in_step;            /* a step is under way */
    bool in_gather;          /* and it gathers radiosity */
    bool compact;            /* and makes radiosity in the 4-byte form (kiln_next_compact) */
    uint64_t tile_run_first; /* how many tile runs the ranks before this one have */
};

/* Blocks of this rank's own items of each saved field, of points or tile runs, into `blocks`, which has room for
 * KILN_FIELDS_MAX; returns how many. They borrow the arrays. */
size_t kiln_field_blocks(const struct kiln_field_set *fields, const struct kiln_rank_data *data,
                         const struct kiln_save_moment *moment, struct kiln_block *blocks);

/* Fills the arrays of own items from the open generation. Of the surface's fields nothing is written where the values
 * are the same; *surface_changed says whether they were not. KILN_IO with a sentence when blocks are missing, have
 * elements of another size, or hold values that no bake can have. */
int kiln_field_blocks_read(const struct kiln_checkpoint *checkpoint, const struct kiln_field_set *fields,
                           const struct kiln_rank_data *data, const struct kiln_save_moment *moment,
                           bool *surface_changed, struct kiln_error *error);

/* KILN_IO: the sentence for a block whose values no bake can have. */
int kiln_block_insane(const char *name, struct kiln_error *error);

#endif
