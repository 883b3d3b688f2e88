/* Texel gather: sends the points of each object to the rank that writes its lightmap (assignment.h). Points of a
 * lightmap in bands go to the rank that has their row. Within a round the points are sent in passes of bounded size, so
 * that MPI counts stay far below 2^31. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_WRITE_TEXEL_GATHER_H
#define KILN_COORDINATOR_OUTPUT_MAP_WRITE_TEXEL_GATHER_H

#include "coordinator/field/result.h"
#include "coordinator/output/map/bands/assignment.h"
#include "coordinator/output/map/denoise/ghosts.h"
#include "coordinator/output/map/layers.h"
#include "coordinator/output/map/texel_record.h"

/* The schedule of messages, computed once. */
struct kiln_texel_gather;

/* Computes the schedule. `layers` must be those of the result's fields. `ghosts` (borrowed; NULL: none) are sent, too.
 * `records_per_pass` limits the records that a rank sends in one pass, and roughly those that it receives; 0 chooses
 * 2^18, 15 MB with the planes that every map has. */
int kiln_texel_gather_create(struct kiln_texel_gather **gather, const struct kiln_bake_result *result,
                             const struct kiln_assignment *assignment, const struct kiln_layers *layers,
                             const struct kiln_ghosts *ghosts, size_t records_per_pass, struct kiln_error *error);
void kiln_texel_gather_destroy(struct kiln_texel_gather **gather);

/* Collective. Sends this rank's points of all objects of the round, and calls `put` exactly once for each point of the
 * objects that this rank writes, and for each of their ghosts. The calls come from several threads at once, in an order
 * that depends on the partition. KILN_BUG if a value is not finite. */
int kiln_texel_gather_round(struct kiln_texel_gather *gather, uint32_t round,
                            void (*put)(void *context, const struct kiln_texel_record *record), void *context,
                            struct kiln_error *error);

#endif
