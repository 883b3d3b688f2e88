/* Scaling simulation: predicts how a bake would scale to more ranks than there are, from the number of points in each
 * cell, the cost of a point, and the bandwidth and latency of a network. */
#ifndef KILN_COORDINATOR_PLAN_SIMULATE_H
#define KILN_COORDINATOR_PLAN_SIMULATE_H

#include <stddef.h>
#include <stdint.h>

#include "coordinator/plan/simulate_light.h"

/* Input of the simulation. Times in seconds, of one rank with all the cores (or the GPU) that a rank gets. */
struct kiln_simulation {
    struct kiln_light_simulation light; /* includes the cells, the ranks of a node and the network */
    double density;      /* factor on the points of each cell, as with finer lightmaps of the same scene */
    double once;         /* serial time, of every rank or while all wait: start, import, scene, BVH, preview */
    double find_a_point; /* time to find a surface point; divided between ranks */
    /* with several ranks: time per point of the scene, on every rank, to build the map of all ranks' points */
    double map_a_point;
    double map_bytes;      /* bytes per point of this map, sent to every rank once */
    double shared_a_point; /* time per own point besides tracing: validity, files, their hashes */
    double shared;         /* time divided between ranks, for any number of points: probes */
    /* the largest lightmap, which several ranks denoise together: its texels, and time for each texel that a rank reads
     * around its own part (output/map/denoise/denoise_parts.h) */
    double largest_map, seen_a_texel;
    /* time per point of one rank, while the others wait: it places the chunks of kiln.h5 in the file */
    double alone_a_point;
    double radiosity_bytes; /* bytes per point in an exchange */
    uint32_t exchanges;
    double saved_bytes;     /* bytes per point in a checkpoint */
    double saved_bandwidth; /* bytes per second at which a node writes checkpoints */
    double save_every;      /* --checkpoint-every, s */
    double copied_byte;     /* time of a rank per byte of its checkpoint that is copied in the background */
};

/* Predicted bake on one number of ranks. Efficiency is the time of one rank without checkpoints, divided by (ranks x
 * time), or for weak scaling by the time. */
struct kiln_scaled {
    uint32_t ranks, nodes;
    double points;
    struct kiln_simulated_light light;
    double trace; /* light and probes */
    double find;  /* finding the points and sending their map to all ranks */
    double exchange, once, write, seconds;
    double saves, save;                  /* number of checkpoints, and their seconds */
    double alone;                        /* part of `write` in which one rank works and the others wait */
    double efficiency, trace_efficiency; /* of the whole bake; of tracing, moves and exchange alone */
};

/* Simulates the bake on `ranks` ranks, with `density` times the points of the cells. Sets efficiencies to 0.
 * KILN_SYSTEM. */
int kiln_simulate(const struct kiln_simulation *simulation, uint32_t ranks, double density, struct kiln_scaled *scaled,
                  struct kiln_error *error);

enum { KILN_CURVE_MAX = 64 };

/* Simulates 1, 2, 4, ... and `most` ranks: strong scaling (the same points in total) and weak scaling (on each rank the
 * points that the strong curve has on one). Writes *count entries, at most KILN_CURVE_MAX. KILN_SYSTEM. */
int kiln_simulate_curves(const struct kiln_simulation *simulation, uint32_t most, struct kiln_scaled *strong,
                         struct kiln_scaled *weak, size_t *count, struct kiln_error *error);

#endif
