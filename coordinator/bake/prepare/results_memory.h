/* Memory for writing the results, from measurements: for `kiln plan`, and for --memory-budget. */
#ifndef KILN_COORDINATOR_BAKE_PREPARE_RESULTS_MEMORY_H
#define KILN_COORDINATOR_BAKE_PREPARE_RESULTS_MEMORY_H

#include "coordinator/bake/prepare/prepare.h"
#include "coordinator/job/job.h"

/* Bytes of a row of kiln.h5 in the measured bakes; the bytes of other fields are added. */
#define KILN_RESULTS_COLUMNS 56.0

/* Memory that a rank takes late, bytes: for passes, their code and MPI. A rank's memory is measured before the light is
 * computed, when this part is not there yet. */
enum { KILN_PASS_BYTES = 8 << 20 };

/* Size of the results. Points and texels may be fractional, as in a plan. */
struct kiln_results_size {
    const struct kiln_scene *scene;
    const struct kiln_job *job;
    double ranks, threads;
    double own;            /* points of the fullest rank */
    double points, texels; /* of all ranks */
};

/* Peak bytes on the fullest rank. The phases of writing run one after another. The fullest rank is the first, which
 * draws the preview. */
uint64_t kiln_results_memory(const struct kiln_results_size *size);

/* Memory of a host that a bake may take, bytes: --memory-budget; auto: 7/8 of kiln_host_memory; none: 0. */
double kiln_memory_budget(const struct kiln_job *job);

/* Bytes of a rank's BVH above which Embree makes it compact: an eighth of the host's budget, or of its memory if there
 * is none, for all of its `node_ranks` ranks together. */
uint64_t kiln_tree_memory(const struct kiln_job *job, int node_ranks);

/* Texels. */
uint64_t kiln_largest_lightmap(const struct kiln_scene *scene);

/* Checks whether the surface points of a scene fit the hosts, before any is made. Points are counted from the texels
 * that the layouts cover, each with the least memory that a point takes, for the `node_ranks` of `ranks` ranks on a
 * host. The memory is kiln_memory_budget, or else the host's. KILN_USAGE, with the object that has most. */
int kiln_points_memory_check(const struct kiln_scene *scene, const struct kiln_job *job, int ranks, int node_ranks,
                             struct kiln_error *error);

/* Collective. Checks whether the bake fits kiln_memory_budget, as far as is known before the first ray. Counts
 * the memory that the ranks of each host have now, including surface points and BVH, and the memory that light, probes
 * and results will take. KILN_USAGE, with what takes how much, and the texel density that would fit. A job without a
 * budget fits. */
int kiln_memory_budget_check(const struct kiln_prepared *prepared, const struct kiln_job *job, uint64_t probes,
                             struct kiln_error *error);

#endif
