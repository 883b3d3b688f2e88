/* `kiln plan`: what a bake on N ranks would need, without baking. */
#ifndef KILN_COORDINATOR_PLAN_PLAN_H
#define KILN_COORDINATOR_PLAN_PLAN_H

#include "coordinator/plan/working_set.h"
#include "coordinator/bake/prepare/prepare.h"
#include "coordinator/bake/reckon/reckon.h"
#include "coordinator/bake/light/visible_from.h"
#include "coordinator/bake/volume/probe_paths.h"
#include "coordinator/integrate/companion.h"
#include "coordinator/plan/simulate.h"

/* Bytes of the fullest rank, by purpose. */
struct kiln_plan_memory {
    /* code, libraries, MPI and working memory: measured in this process after it has allocated the items below */
    uint64_t program;
    uint64_t scene;       /* the mapped scene file (shared by the ranks of a node) without its images */
    uint64_t textures;    /* images of the scene file */
    uint64_t geometry;    /* world triangles */
    uint64_t bvh;         /* Embree's own, estimated by triangles; 0 with a GPU */
    uint64_t surface_all; /* tiles and lightmaps: the same on every rank */
    uint64_t surface_own; /* points, pieces and tile runs of one rank */
    uint64_t light;       /* irradiance and radiosity */
    uint64_t volume;      /* probes */
    uint64_t results;     /* largest need while files are written and the preview is drawn */
    /* while points are sent to other ranks, before there are probes and results: a second copy of surface or results */
    uint64_t moving;
    uint64_t in_step; /* while a step goes on, of the companions that accompany it: sums, records, a BVH of the host */
    uint64_t total;   /* without `device`; with the largest of `moving`, `in_step` and what comes later */
    uint64_t device;  /* memory of the GPU, with all points of this process */
};

/* Seconds of the slowest rank, assuming that its cores are its own: other programs on this machine hardly lengthen the
 * time samples of light. */
struct kiln_plan_seconds {
    double import, world, surface, validity; /* reading, BVH, surface points (over ranks), buried points */
    double views;                            /* points that the views of --only-visible-from see (over ranks) */
    double emission;                         /* light traced from the lights */
    double light[KILN_ROLES_MAX];            /* steps of each role */
    double probes, exchange;
    double move;  /* sending points to other ranks in a redistribution */
    double save;  /* checkpoints */
    double write; /* lightmaps, kiln.h5, volume.hdf, preview */
    double total;
};

enum { KILN_PLAN_SAMPLES = 128 };

/* Time sample: measured cost of some consecutive points. */
struct kiln_plan_sample {
    uint64_t first;                       /* the first of the tried points, in global order */
    uint64_t points[KILN_COST_KINDS_MAX]; /* of each kind of steps */
    /* time of all samples of a step of each kind. On processors it is the mean working time of the threads: this leaves
     * out other programs, and waiting for the last thread, which is long at the end of so short a run */
    double seconds[KILN_COST_KINDS_MAX];
};

/* Release with kiln_plan_release. */
struct kiln_plan {
    struct kiln_planned_steps steps;
    struct kiln_surface_report surface;
    struct kiln_plan_memory memory;
    struct kiln_plan_seconds seconds;
    /* The bake as reckoned, on both backends (bake/reckon/reckon.h). Of `backend`, which a rank of this machine has,
     * the phases up to the probes are measured and simulated. */
    struct kiln_reckon_question question;
    struct kiln_reckoned reckoned[KILN_RECKON_BACKENDS];
    enum kiln_reckon_backend backend;
    struct kiln_foretold foretold; /* rounds of a bake whose error is asked for */
    uint64_t triangles;
    /* compressed sizes of the result files (estimated) */
    uint64_t lightmap_bytes, h5_bytes, volume_bytes, scene_bytes, preview_bytes, export_bytes;
    uint64_t transport_bytes;  /* kept transport (integrate/relight/transport.h); exact for the planned steps */
    uint64_t disk_bytes;       /* sum of these files */
    uint64_t checkpoint_bytes; /* largest checkpoint; two generations are kept while the bake runs */
    uint64_t probes;
    double bytes_per_point;           /* fullest rank: surface and light, for each of its own points when it has all */
    double bytes_per_triangle;        /* scene and geometry; images and Embree's BVH aside */
    double exchange_bytes;            /* bytes that a rank receives in each bounce */
    uint32_t bounces;                 /* assumed */
    struct kiln_visible_from visible; /* numbers of points that the job's views need */
    struct kiln_companion_measured companions[KILN_COMPANIONS]; /* each at its place */
    struct kiln_probe_paths_cost probe_paths;
    struct kiln_working_set working_set; /* points at which gather rays of a range end */
    struct kiln_plan_sample samples[KILN_PLAN_SAMPLES];
    size_t sample_count;
    double calibration_seconds;
    struct kiln_scaled here; /* the bake itself, on job->plan.ranks ranks; efficiencies are 0 */
    /* predicted strong and weak scaling curves, up to job->plan.ranks */
    struct kiln_scaled strong[KILN_CURVE_MAX], weak[KILN_CURVE_MAX];
    size_t curve_count;
};

/* Makes the plan. Not collective: `prepared` is on MPI_COMM_SELF, and `phases` has the times of its preparation. Builds
 * the surface points of one of job->plan.ranks ranks to learn sizes. Traces a sample of the points to learn times (20 s
 * at most), with the backend and threads that a rank of this machine has. With --only-visible-from, points that no view
 * needs become invalid, as in the bake. job->plan.points, if not 0, is the number of surface points at which the
 * scaling curves begin. */
int kiln_plan_make(struct kiln_plan *plan, const struct kiln_prepared *prepared, const struct kiln_job *job,
                   const struct kiln_phases *phases, struct kiln_error *error);
void kiln_plan_release(struct kiln_plan *plan);

#endif
