/* The run report, run.json: what ran, on which machines, how long each phase took on each rank, and the error and
 * energy balance that were reached. */
#ifndef KILN_COORDINATOR_BAKE_REPORT_RUN_REPORT_H
#define KILN_COORDINATOR_BAKE_REPORT_RUN_REPORT_H

#include "coordinator/bake/light/density_check.h"
#include "coordinator/bake/prepare/prepare.h"
#include "coordinator/bake/light/visible_from.h"
#include "coordinator/field/result.h"
#include "coordinator/integrate/integrate.h"
#include "coordinator/output/map/write/lightmaps.h"
#include "coordinator/output/points_ahead.h"
#include "coordinator/output/vertex_light.h"

struct kiln_run {
    const struct kiln_job *job;
    const struct kiln_prepared *prepared;
    const struct kiln_solution *solution;
    const struct kiln_volume_result *volume;      /* size 0: there is no volume */
    const struct kiln_lightmap_report *lightmaps; /* rank 0: one for each lightmap of the surface */
    const struct kiln_vertex_light *vertices;     /* rank 0, if the job asks for them */
    const struct kiln_density_check *density;
    const struct kiln_visible_from *visible;
    const struct kiln_phases *phases;
    const struct kiln_points_ahead *ahead; /* what was packed beside the passes; NULL: nothing */
    enum kiln_gloss_mode materials;        /* as asked for; the job has the settled mode */
    uint64_t probe_rays;                   /* rays of the probes on this rank */
    const char *directory;
};

/* Makes the part of the report that says what was computed, without when, where or how fast. It is the same for any
 * number of ranks and threads, and is stored in the HDF5 files too. Compact JSON; release with free. NULL if memory is
 * short. */
char *kiln_provenance(const struct kiln_job *job, const struct kiln_prepared *prepared);

/* The message for a scene without light: it names the possible kinds of light, and the option that adds light. */
#define KILN_NO_LIGHT                                                                                                  \
    "there is no light: no emissive triangle, no light, no environment (--environment R,G,B gives one)"

/* Makes the warnings, an array of sentences: findings of the importer that every bake repeats (KILN_NOTE_REPEATED), and
 * the lack of any light. Release with json_decref. */
json_t *kiln_scene_warnings(const struct kiln_prepared *prepared);

/* Collective. Creates the report on rank 0; the other ranks get NULL. Release with json_decref. */
int kiln_run_report(json_t **report, const struct kiln_run *run, struct kiln_error *error);

#endif
