/* Working set of a rank if gather rays have a maximum length, the tracing range: the triangles and surface points
 * within that distance of its own points, and the radiance probes (Vandersanden, "Radiance Cells", 2023, section 4.3.2:
 * the tracing range limits the data that a cell's rays may reach). */
#ifndef KILN_COORDINATOR_PLAN_WORKING_SET_H
#define KILN_COORDINATOR_PLAN_WORKING_SET_H

#include "coordinator/bake/prepare/prepare.h"
#include "coordinator/job/job.h"

/* Working set of one rank, an upper bound: distances are measured along each axis, between voxels of a grid over the
 * scene with 1/48 of its longest side. Points that see no probe have rays of unlimited length; these rays are not
 * counted. */
struct kiln_rank_set {
    uint64_t own_points;        /* points that the rank computes */
    uint64_t triangles, points; /* within the range of its own points */
    uint64_t probes;            /* probes that its rays may read; each rank keeps all probes */
    uint64_t bytes;             /* geometry and radiosity of these triangles and points, and these probes */
};

/* Working sets of all ranks; all zero if rays have no maximum length. Release with kiln_working_set_release. */
struct kiln_working_set {
    struct kiln_rank_set *ranks; /* of each rank */
    uint32_t rank_count;
    struct kiln_rank_set most; /* maximum of each number over the ranks */
    double triangles_mean, points_mean, probes_mean, bytes_mean;
    uint64_t bytes_all;   /* of all triangles and points */
    uint64_t probes;      /* number of probes of the whole scene */
    uint64_t probe_bytes; /* memory of all probes */
};

/* Finds the working sets. `prepared` has all surface points; `triangle_bytes` is the size of a triangle's geometry.
 * Ranks have the points with which they begin a bake (with --partition objects, split between tile runs). Not
 * collective. KILN_USAGE for too many probes; KILN_SYSTEM. Nothing needs to be released after a failure. */
int kiln_working_set_find(struct kiln_working_set *set, const struct kiln_prepared *prepared,
                          const struct kiln_job *job, double triangle_bytes, struct kiln_error *error);
void kiln_working_set_release(struct kiln_working_set *set);

#endif
