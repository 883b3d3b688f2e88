/* `kiln plan`: what a bake on N ranks would need, without baking. */
#ifndef KILN_COORDINATOR_BAKE_PLAN_H
#define KILN_COORDINATOR_BAKE_PLAN_H

#include "coordinator/bake/prepare.h"

/* Bytes of the fullest rank, by purpose. */
struct kiln_plan_memory {
    uint64_t program;     /* the process before it has a scene: code, libraries, MPI */
    uint64_t scene;       /* the mapped scene file (shared by the ranks of a node) without its images */
    uint64_t textures;    /* its images */
    uint64_t geometry;    /* world triangles */
    uint64_t bvh;         /* Embree's own, estimated by triangles */
    uint64_t surface_all; /* tiles and lightmaps: the same on every rank */
    uint64_t surface_own; /* points, pieces and fragments of the share */
    uint64_t transport;   /* irradiance and radiosity */
    uint64_t volume;      /* probes */
    uint64_t total;
};

struct kiln_plan {
    struct kiln_surface_report surface;
    struct kiln_plan_memory memory;
    uint64_t triangles;
    uint64_t lightmap_bytes, h5_bytes, volume_bytes; /* of the results, uncompressed */
    uint64_t probes;
    double bytes_per_point;    /* fullest rank: surface and transport, for each of its own points when it has all */
    double bytes_per_triangle; /* scene and geometry; images and Embree's BVH aside */
    double exchange_bytes;     /* a rank receives in each bounce */
    uint32_t bounces;          /* assumed */
    double seconds_direct, seconds_bounces, seconds_final, seconds_probes, seconds_exchange; /* fullest rank */
    double seconds;            /* their sum: import, writing and preview not included */
};

/* Not collective (prepared on MPI_COMM_SELF). Builds the share of one of job->ranks ranks for its sizes, and traces a sample of
 * the surface points for the times, with the threads that a rank of this machine has. */
int kiln_plan_make(struct kiln_plan *plan, const struct kiln_prepared *prepared, const struct kiln_job *job, struct kiln_error *error);

#endif
