/* How a bake would scale over more ranks than there are: from the cells' points, what a point costs, and a network's
 * figures. */
#ifndef KILN_COORDINATOR_PLAN_SIMULATE_H
#define KILN_COORDINATOR_PLAN_SIMULATE_H

#include <stddef.h>
#include <stdint.h>

#include "coordinator/plan/simulate_light.h"

/* Input of the simulation. Times in seconds, of one rank with all the cores (or the GPU) that a rank gets. */
struct kiln_simulation {
    struct kiln_light_simulation light; /* the cells, the ranks of a node and the network among it */
    double density;      /* points for each one that the cells have: the same scene with finer lightmaps */
    double once;         /* done by every rank, or while all wait: start, import, scene, BVH, preview */
    double find_a_point; /* divided between ranks: where the points lie */
    /* done by every rank, when there are several, for all points: the map of what the others found */
    double map_a_point;
    double map_bytes;      /* of a point, sent to every rank once */
    double shared_a_point; /* done for own points besides tracing: validity, files, their hashes */
    double shared;         /* divided between ranks whatever the number of points: probes */
    /* all ranks denoise the largest lightmap, when there are several: its texels, and seconds for each texel beside a
     * rank's part, which it sees (output/map/denoise/denoise_parts.h) */
    double largest_map, seen_a_texel;
    /* done by one rank for all points while the others wait: where each chunk of kiln.h5 belongs */
    double alone_a_point;
    double radiosity_bytes; /* of a point, in an exchange */
    uint32_t exchanges;
    double saved_bytes;     /* of a point, in a checkpoint */
    double saved_bandwidth; /* at which a node writes checkpoints, bytes a second */
    double save_every;      /* --checkpoint-every, s */
    double copied_byte;     /* s of a rank, for each byte of its checkpoint that is copied behind */
};

/* One number of ranks. Efficiency is the time of one rank that saves nothing over (ranks x time), of weak scaling over
 * time alone. */
struct kiln_scaled {
    uint32_t ranks, nodes;
    double points;
    struct kiln_simulated_light light;
    double trace; /* light and probes */
    double find;  /* the points, and telling all of them */
    double exchange, once, write, seconds;
    double saves, save;                  /* checkpoints, and their seconds */
    double alone;                        /* of `write`: one rank, while the others wait */
    double efficiency, trace_efficiency; /* of all; of tracing, moves and exchange alone */
};

/* The bake with `density` x cells' points on `ranks` ranks; efficiencies are left 0. KILN_SYSTEM. */
int kiln_simulate(const struct kiln_simulation *simulation, uint32_t ranks, double density, struct kiln_scaled *scaled,
                  struct kiln_error *error);

enum { KILN_CURVE_MAX = 64 };

/* 1, 2, 4, ... and `most` ranks, strong (all of them the same points) and weak (each rank as many as one has in the
 * strong one). Writes *count entries, at most KILN_CURVE_MAX. KILN_SYSTEM. */
int kiln_simulate_curves(const struct kiln_simulation *simulation, uint32_t most, struct kiln_scaled *strong,
                         struct kiln_scaled *weak, size_t *count, struct kiln_error *error);

#endif
