/* run.json: what ran, on what, how long each phase took on each rank, the error and energy reached. */
#ifndef KILN_COORDINATOR_BAKE_RUN_REPORT_H
#define KILN_COORDINATOR_BAKE_RUN_REPORT_H

#include "coordinator/bake/prepare.h"
#include "coordinator/field/result.h"
#include "coordinator/integrate/integrate.h"
#include "coordinator/output/output.h"

struct kiln_run {
    const struct kiln_job *job;
    const struct kiln_prepared *prepared;
    const struct kiln_solution *solution;
    const struct kiln_volume_result *volume;      /* size 0: none */
    const struct kiln_lightmap_report *lightmaps; /* one a lightmap of the surface, rank 0 */
    const struct kiln_phases *phases;
    uint64_t probe_rays; /* of this rank */
    const char *directory;
};

/* The part of the report that says what was computed and nothing of when or how fast: kept in the HDF5 files too, equal
 * for any number of ranks and threads. Compact JSON; release with free. NULL when out of memory. */
char *kiln_provenance(const struct kiln_job *job, const struct kiln_prepared *prepared);

/* Collective. Makes the report; rank 0 gets it, the others NULL. json_decref it. */
int kiln_run_report(json_t **report, const struct kiln_run *run, struct kiln_error *error);

#endif
