/* `kiln plan`: what a bake on N ranks would need, without baking. */
#ifndef KILN_COORDINATOR_PLAN_PLAN_H
#define KILN_COORDINATOR_PLAN_PLAN_H

#include "coordinator/plan/working_set.h"
#include "coordinator/bake/prepare/prepare.h"
#include "coordinator/bake/light/visible_from.h"
#include "coordinator/bake/volume/probe_paths.h"
#include "coordinator/integrate/companion.h"
#include "coordinator/plan/simulate.h"

/* Bytes of the fullest rank, by purpose. */
struct kiln_plan_memory {
    /* code, libraries, MPI and working space: measured in this process, once it has all that follows */
    uint64_t program;
    uint64_t scene;       /* the mapped scene file (shared by the ranks of a node) without its images */
    uint64_t textures;    /* its images */
    uint64_t geometry;    /* world triangles */
    uint64_t bvh;         /* Embree's own, estimated by triangles; 0 with a GPU */
    uint64_t surface_all; /* tiles and lightmaps: the same on every rank */
    uint64_t surface_own; /* points, pieces and tile runs of one rank */
    uint64_t light;       /* irradiance and radiosity */
    uint64_t volume;      /* probes */
    uint64_t results;     /* while files are written, and the preview is drawn: the most of these */
    /* while points go to other ranks, which is before there are probes and results: surface or results once more */
    uint64_t moving;
    uint64_t in_step; /* while a step goes on, of the companions that accompany it: sums, records, a BVH of the host */
    uint64_t total;   /* without `device`; with the largest of `moving`, `in_step` and what comes later */
    uint64_t device;  /* of the GPU: with the points of this process, that is, all of them */
};

/* Seconds of the rank that is done last, its cores being its own: other work on this machine hardly lengthens the
 * samples of light. */
struct kiln_plan_seconds {
    double import, world, surface, validity; /* reading, BVH, finding points (divided), finding buried ones */
    double views;                            /* finding what the views of --only-visible-from see (divided) */
    double emission;                         /* light traced from the lights */
    double light[KILN_ROLES_MAX];            /* of the steps of each role */
    double probes, exchange;
    double move;  /* of points to other ranks, when they are distributed anew */
    double save;  /* checkpoints */
    double write; /* lightmaps, kiln.h5, volume.hdf, preview */
    double total;
};

enum { KILN_PLAN_SAMPLES = 128 };

/* Cost of points where they were tried. */
struct kiln_plan_sample {
    uint64_t first;                       /* the first of the tried points, in global order */
    uint64_t points[KILN_COST_KINDS_MAX]; /* of each kind of steps */
    /* all samples of a step of each kind; of processors what each thread worked on the mean: neither other programs
     * count, nor that threads wait for the last one, which at the end of so short a run is long */
    double seconds[KILN_COST_KINDS_MAX];
};

/* Release with kiln_plan_release. */
struct kiln_plan {
    struct kiln_planned_steps steps;
    struct kiln_surface_report surface;
    struct kiln_plan_memory memory;
    struct kiln_plan_seconds seconds;
    uint64_t triangles;
    /* of the results, compressed (estimated) */
    uint64_t lightmap_bytes, h5_bytes, volume_bytes, scene_bytes, preview_bytes, export_bytes;
    uint64_t
        transport_bytes; /* kept beside them (integrate/relight/transport.h); exact for the steps that are planned */
    uint64_t disk_bytes; /* their sum */
    uint64_t checkpoint_bytes; /* of a generation, the largest; two are kept while the bake runs */
    uint64_t probes;
    double bytes_per_point;           /* fullest rank: surface and light, for each of its own points when it has all */
    double bytes_per_triangle;        /* scene and geometry; images and Embree's BVH aside */
    double exchange_bytes;            /* that a rank receives in each bounce */
    uint32_t bounces;                 /* assumed */
    struct kiln_visible_from visible; /* what the job's views need: numbers of points */
    struct kiln_companion_measured companions[KILN_COMPANIONS]; /* each at its place */
    struct kiln_probe_paths_cost probe_paths;
    struct kiln_working_set working_set; /* where gather rays end at a range */
    struct kiln_plan_sample samples[KILN_PLAN_SAMPLES];
    size_t sample_count;
    double calibration_seconds;
    struct kiln_scaled here; /* the bake itself, on job->plan.ranks ranks; efficiencies are 0 */
    /* how the bake would scale up to job->plan.ranks, and the cells that this is reckoned from */
    struct kiln_scaled strong[KILN_CURVE_MAX], weak[KILN_CURVE_MAX];
    size_t curve_count;
};

/* Not collective (prepared on MPI_COMM_SELF, with `phases` as it took them). Builds the surface points of one of
 * job->plan.ranks ranks for their sizes, and traces a sample of the surface points for the times (20 s at most), with
 * the backend and the threads that a rank of this machine has. With --only-visible-from, points that no view needs lose
 * their validity, as in the bake. job->plan.points, when not 0, stands for how many surface points the scaling curves
 * begin with. */
int kiln_plan_make(struct kiln_plan *plan, const struct kiln_prepared *prepared, const struct kiln_job *job,
                   const struct kiln_phases *phases, struct kiln_error *error);
void kiln_plan_release(struct kiln_plan *plan);

#endif
