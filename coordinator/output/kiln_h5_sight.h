/* The visibility grid in kiln.h5: group /visibility. Private to coordinator/output. */
#ifndef KILN_COORDINATOR_OUTPUT_KILN_H5_SIGHT_H
#define KILN_COORDINATOR_OUTPUT_KILN_H5_SIGHT_H

#include "coordinator/field/result.h"
#include "coordinator/output/h5.h"

/* Visibility grid of all ranks, on rank 0: unit << 32 | visible unit, ascending, unique. Empty on other ranks. */
struct kiln_h5_sight {
    uint64_t *pairs;
    size_t count;
};

/* Collective. Does nothing without a grid. KILN_SYSTEM on all ranks. Release with kiln_h5_sight_release. */
int kiln_h5_sight_gather(struct kiln_h5_sight *sight, const struct kiln_bake_result *result, struct kiln_error *error);
void kiln_h5_sight_release(struct kiln_h5_sight *sight);

/* Collective. Upper bound of the group's size, bytes. */
uint64_t kiln_h5_sight_space(const struct kiln_bake_result *result);

/* Rank 0 only. */
int kiln_h5_sight_write(struct kiln_h5 *h5, const struct kiln_h5_sight *sight, const struct kiln_bake_result *result,
                        struct kiln_error *error);

#endif
