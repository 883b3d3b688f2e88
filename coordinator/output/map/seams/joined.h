/* Joined seams: the seams of lightmaps whose objects touch are solved together, each group of them (joints.h) as one
 * system of least squares (seam_system.h), wherever its maps are.
 *
 * The rank that has a map adds what its seams and joints read: texels with their values, and the samples, one side at a
 * time. All of a group travels to the owner of its least lightmap, which solves it; the values travel back to the maps'
 * owners. What travels are texels at borders only. A system is in the order of lightmaps, texels and joints, so the
 * result is the same on any number of ranks.
 *
 * Of a map in bands (bands.h) each rank adds its band, and the planes of its group, which are systems of their own, are
 * solved by several ranks at once. The seams of such a map are solved here even if no other object touches it. */
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
    uint32_t alone;                   /* its number */
    const struct kiln_lightmap *lightmaps;
    const struct kiln_assignment *assignment;
    const struct kiln_map_planes *planes; /* of all maps */
    bool measure;                         /* the lone map's differences are found, and no value changes */
};

/* Report on a map in bands: its samples, and the root mean square of the difference in luminance there. */
struct kiln_joined_report {
    uint64_t samples;
    double before, after;
};

/* Not collective. */
int kiln_joined_create(struct kiln_joined **joined, const struct kiln_joined_params *params, struct kiln_error *error);
void kiln_joined_destroy(struct kiln_joined **joined);

/* Adds a map that has a joint, or a rank's band of it. It must be filled, and `nearest` be that of the stage "borders";
 * its margin will be filled. Collective if the map is one of bands; else several threads may add different maps at
 * once. */
int kiln_joined_add(struct kiln_joined *joined, uint32_t number, struct kiln_map *map,
                    const struct kiln_chart_graph *graph, const uint32_t *nearest, struct kiln_error *error);

/* Collective: solves all groups, once every map with a joint has been added on one rank, or all bands of it. */
int kiln_joined_solve(struct kiln_joined *joined, struct kiln_error *error);

/* Report on a map in bands, on all ranks, when all is solved. */
const struct kiln_joined_report *kiln_joined_report(const struct kiln_joined *joined, uint32_t number);

/* Puts the solution into a map of this rank that has a joint; margin texels with a value of their own become their own
 * `nearest`. Not collective. */
void kiln_joined_apply(const struct kiln_joined *joined, uint32_t number, struct kiln_map *map, uint32_t *nearest);

#endif
