/* Fields in checkpoints: each field is one block with the name of the field; its elements are counted in the field's
 * domain, beginning at the first surface point. Not collective. */
#ifndef KILN_COORDINATOR_FIELD_FIELD_BLOCKS_H
#define KILN_COORDINATOR_FIELD_FIELD_BLOCKS_H

#include "coordinator/field/rank_data.h"
#include "coordinator/run/checkpoint.h"

/* Moment at which a checkpoint is written; it determines the fields in the checkpoint. */
struct kiln_save_moment {
    bool in_step;            /* a step is under way */
    bool in_gather;          /* the step gathers radiosity */
    bool compact;            /* the step makes radiosity in the 4-byte form (kiln_next_compact) */
    uint64_t tile_run_first; /* number of tile runs of all lower ranks */
};

/* Makes the blocks of this rank's own items (points or tile runs), one for each saved field, in `blocks`, which has
 * room for KILN_FIELDS_MAX. Returns their number. They borrow the arrays. */
size_t kiln_field_arrays(const struct kiln_field_set *fields, const struct kiln_rank_data *data,
                         const struct kiln_save_moment *moment, struct kiln_array_range *blocks);

/* Fills the arrays of own items from the open generation. The surface's fields are written only if their values differ;
 * *surface_changed says whether they did. KILN_IO with a sentence when blocks are missing, have elements of another
 * size, or hold values that no bake can have. */
int kiln_field_arrays_read(const struct kiln_checkpoint *checkpoint, const struct kiln_field_set *fields,
                           const struct kiln_rank_data *data, const struct kiln_save_moment *moment,
                           bool *surface_changed, struct kiln_error *error);

/* Returns KILN_IO, with the sentence for a block with values that no bake can have. */
int kiln_array_insane(const char *name, struct kiln_error *error);

#endif
