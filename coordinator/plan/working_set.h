/* What a rank touches when gather rays end at a range: the triangles and surface points within that distance of its own
 * points, and the radiance probes (Vandersanden, "Radiance Cells", 2023, section 4.3.2: the tracing range is a limit on
 * the data that a cell's rays may reach). */
#ifndef KILN_COORDINATOR_PLAN_WORKING_SET_H
#define KILN_COORDINATOR_PLAN_WORKING_SET_H

#include "coordinator/bake/prepare.h"
#include "coordinator/job/job.h"

/* Of the rank that needs most, and the mean over the ranks. An upper bound: distances are those of the voxels of a grid
 * over the scene, 1/48 of its longest side, and measured along each axis. Points that see no probe, whose rays have no
 * end, are not counted. All zeros: rays have no end. */
struct kiln_working_set {
    uint64_t triangles_most, points_most;
    double triangles_mean, points_mean;
    uint64_t bytes_most; /* geometry and radiosity of these, and all probes */
    double bytes_mean;
    uint64_t bytes_all;   /* of all triangles and points */
    uint64_t probes;      /* on each rank */
    uint64_t probe_bytes; /* of them */
};

/* `prepared` has all surface points; `triangle_bytes`: of the geometry of one. Ranks have contiguous ranges of cells,
 * of as many points as can be. Not collective. KILN_USAGE for too many probes; KILN_SYSTEM. */
int kiln_working_set_find(struct kiln_working_set *set, const struct kiln_prepared *prepared,
                          const struct kiln_job *job, double triangle_bytes, struct kiln_error *error);

#endif
