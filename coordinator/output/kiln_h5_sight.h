/* The visibility grid in kiln.h5: group /visibility. Private to coordinator/output. */
#ifndef KILN_COORDINATOR_OUTPUT_KILN_H5_SIGHT_H
#define KILN_COORDINATOR_OUTPUT_KILN_H5_SIGHT_H

#include "coordinator/field/result.h"
#include "coordinator/output/h5.h"

/* The grid of all ranks, on rank 0: unit << 32 | unit that it sees, ascending, none twice. Elsewhere empty. */
struct kiln_h5_sight {
    uint64_t *pairs;
    size_t count;
};

/* Collective. Nothing, if the bake has no grid. KILN_SYSTEM on all ranks. Release with kiln_h5_sight_release. */
int kiln_h5_sight_gather(struct kiln_h5_sight *sight, const struct kiln_bake_result *result, struct kiln_error *error);
void kiln_h5_sight_release(struct kiln_h5_sight *sight);

/* Collective. Bytes that the group takes at most. */
uint64_t kiln_h5_sight_space(const struct kiln_bake_result *result);

/* Rank 0 only. */
int kiln_h5_sight_write(struct kiln_h5 *h5, const struct kiln_h5_sight *sight, const struct kiln_bake_result *result,
                        struct kiln_error *error);

#endif
