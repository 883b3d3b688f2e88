/* Joined seams: the seams of lightmaps whose objects touch are solved together, each group of them (joints.h) as one
 * system of least squares (seam_system.h), wherever its maps are.
 *
 * The rank that owns a map adds the texels, with their values, that the map's seams and joints read, and the samples,
 * one side at a time. They are sent to the rank that owns the group's lowest-numbered lightmap. This rank solves the
 * group and sends the values back to the maps' owners. Only texels at borders are sent. A system is in the order of
 * lightmaps, texels and joints, so the result is the same on any number of ranks.
 *
 * A map in bands (bands.h) is added by all ranks, each with its band. The planes of its group are independent systems,
 * and several ranks solve them at once. The seams of such a map are solved here even if no other object touches it. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_SEAMS_JOINED_H
#define KILN_COORDINATOR_OUTPUT_MAP_SEAMS_JOINED_H

#include <mpi.h>

#include "coordinator/output/map/charts/chart_graph.h"
#include "coordinator/output/map/seams/joints.h"
#include "coordinator/output/map/map.h"
#include "coordinator/output/map/bands/assignment.h"

struct kiln_joined;

/* Input of the seam solver; all borrowed. */
struct kiln_joined_params {
    MPI_Comm communicator;
    const struct kiln_joints *joints; /* NULL: the seams of one map in bands alone */
    uint32_t alone;                   /* without joints: the number of this map */
    const struct kiln_lightmap *lightmaps;
    const struct kiln_assignment *assignment;
    const struct kiln_map_planes *planes; /* of all maps */
    bool measure;                         /* only measure the differences at seams of map `alone`; change nothing */
};

/* Report on a map in bands: its samples, and the root mean square of the difference in luminance there. */
struct kiln_joined_report {
    uint64_t samples;
    double before, after;
};

/* Not collective. */
int kiln_joined_create(struct kiln_joined **joined, const struct kiln_joined_params *params, struct kiln_error *error);
void kiln_joined_destroy(struct kiln_joined **joined);

/* Adds a map with joints, or this rank's band of one. The map must be filled, and `nearest` must come from the stage
 * "borders"; this function fills the margin. Collective if the map is in bands; otherwise several threads may add
 * different maps at once. */
int kiln_joined_add(struct kiln_joined *joined, uint32_t number, struct kiln_map *map,
                    const struct kiln_chart_graph *graph, const uint32_t *nearest, struct kiln_error *error);

/* Collective. Solves all groups. Before the call every map with a joint must have been added: on one rank, or, if it is
 * in bands, each band by its rank. */
int kiln_joined_solve(struct kiln_joined *joined, struct kiln_error *error);

/* Returns the report on a map in bands, on all ranks, after kiln_joined_solve. */
const struct kiln_joined_report *kiln_joined_report(const struct kiln_joined *joined, uint32_t number);

/* Writes the solution into a map of this rank that has a joint. A margin texel that gets a value becomes its own
 * `nearest`. Not collective. */
void kiln_joined_apply(const struct kiln_joined *joined, uint32_t number, struct kiln_map *map, uint32_t *nearest);

#endif
