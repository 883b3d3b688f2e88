/* Data that a rank touches when gather rays end at a range: the triangles and surface points within that distance of
 * its own points, and the radiance probes (Vandersanden, "Radiance Cells", 2023, section 4.3.2: the tracing range is a
 * limit on the data that a cell's rays may reach). */
#ifndef KILN_COORDINATOR_PLAN_WORKING_SET_H
#define KILN_COORDINATOR_PLAN_WORKING_SET_H

#include "coordinator/bake/prepare/prepare.h"
#include "coordinator/job/job.h"

/* Data of one rank. An upper bound: distances are those of the voxels of a grid over the scene, 1/48 of its longest
 * side, and measured along each axis. Points whose rays have no end, as they see no probe, are not counted. */
struct kiln_rank_set {
    uint64_t own_points;        /* that it computes */
    uint64_t triangles, points; /* within the range of these */
    uint64_t probes;            /* that its rays may ask; each rank keeps all of them */
    uint64_t bytes;             /* geometry and radiosity of the triangles and points, and these probes */
};

/* All zeros: rays have no end. Release with kiln_working_set_release. */
struct kiln_working_set {
    struct kiln_rank_set *ranks; /* of each rank */
    uint32_t rank_count;
    struct kiln_rank_set most; /* of each number, that of the rank with most */
    double triangles_mean, points_mean, probes_mean, bytes_mean;
    uint64_t bytes_all;   /* of all triangles and points */
    uint64_t probes;      /* of the whole scene */
    uint64_t probe_bytes; /* of them */
};

/* `prepared` has all surface points; `triangle_bytes`: of the geometry of one. Ranks have the points that they begin a
 * bake with (with --partition objects, cut between tile runs). Not collective. KILN_USAGE for too many probes;
 * KILN_SYSTEM. Nothing is left to release after a failure. */
int kiln_working_set_find(struct kiln_working_set *set, const struct kiln_prepared *prepared,
                          const struct kiln_job *job, double triangle_bytes, struct kiln_error *error);
void kiln_working_set_release(struct kiln_working_set *set);

#endif
