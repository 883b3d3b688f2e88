/* The light of all surface points as the lockstep runner computes it: irradiance of this rank's points, radiosity of
 * all points, and the report of the steps. */
#ifndef KILN_COORDINATOR_INTEGRATE_SOLUTION_H
#define KILN_COORDINATOR_INTEGRATE_SOLUTION_H

#include "coordinator/field/packed_error.h"
#include "coordinator/field/radiosity_allgather.h"
#include "coordinator/field/rank_data.h"
#include "coordinator/integrate/step.h"
#include "worker/pass/visibility_cache.h"

/* Visibility grid of a bake in which nodes receive only the radiosity that their points see. Made by reach/sight.h,
 * which defines units. */
struct kiln_sight {
    uint64_t units;
    uint64_t *first; /* first point of each unit, and one more at the end; the same on all ranks */
    /* for the units of which this rank has points: unit << 32 | visible unit, ascending, unique */
    uint64_t *pairs;
    size_t pair_count;
    uint64_t sent;  /* bytes sent by this rank to complete the grid */
    double seconds; /* of this rank */
};

/* Sets the pointer to NULL, which may be NULL. */
void kiln_sight_destroy(struct kiln_sight **sight);

#define KILN_TAIL_DIVERGES (-1.0)

/* Report on the radiance probes of a bake whose gather rays end at a range. All zeros: none. The same on all ranks. */
struct kiln_radiance_report {
    bool placed;                 /* `probes`, `moved`, `off` and `alone` are known */
    uint64_t probes, moved, off; /* all probes; those moved off the grid; those switched off */
    uint64_t rays;               /* of all steps and runs; known after all light is computed */
    uint64_t bytes;              /* of the data of all probes, on each rank */
    uint64_t alone;              /* surface points that see no probe: their rays are unlimited */
    double spacing;              /* m */
    uint32_t side, samples;      /* of a probe: elements along the side of its map; rays in each step that gathers */
};

/* Report on the light paths of a bake; all zeros: it traces none. The same on all ranks. */
struct kiln_landing_report {
    uint64_t photons;    /* of an iteration: at least one for each aim */
    uint32_t iterations; /* of a step, in the first round */
    uint64_t aims;       /* pairs of a lamp and an object with gloss, or a part of one */
    uint32_t rays;       /* rays per point of the last step that share its light with paths; 0: none */
    double radius;       /* m, initial merge radius of the last step that merged */
    uint32_t on_host;    /* passes that the device leaves to the host: bits KILN_PASS_INDEX_..., of this rank */
};

/* The object whose published light has the largest error (parts/worst.h). The same on all ranks. */
struct kiln_worst_object {
    bool known;
    uint32_t object;
    double published; /* relative error that 95 % of its texels stay below */
};

struct kiln_integrate_report {
    struct kiln_roles roles; /* of the steps */
    struct kiln_step_reports steps;
    uint32_t bounces;     /* indirect bounces gathered one by one or summed for the final gather */
    bool tail;            /* a geometric tail was added */
    double tail_ratio[3]; /* last ratio of one bounce's power to that of the bounce before */
    double tail_share;    /* of all reflected power, luminance */
    /* relative to all light: error of the tail; without a tail (the equal schedule) the bounces left out;
     * KILN_TAIL_DIVERGES: their sum is infinite */
    double tail_error;
    double tail_object_error; /* largest over all objects: last kiln_step_report.object_error */
    double tail_tile_error;   /* largest over all tiles, for example in a pocket that traps light */
    uint32_t tail_pocket;     /* that tile's object */
    uint32_t restarts;        /* number of times that the bake was resumed from a checkpoint */
    double seconds_before;    /* time of earlier runs, up to their last checkpoint */
    double waiting_seconds;   /* of this rank: waiting for others at the ends of steps */
    bool steals_work;         /* whether the ranks of this rank's node compute points for each other */
    uint64_t received;        /* bytes of radiosity from other nodes */
    uint64_t whole;           /* as `received`, if nodes received the radiosity of all points */
    uint64_t computed_again;  /* points of this rank whose rays met absent radiosity, counted once per recomputation */
    struct kiln_radiance_report radiance;
    struct kiln_landing_report landing;
    struct kiln_visibility_counts visibility; /* of this rank, in this run (patches.h) */
    uint64_t links, link_bytes;               /* kept on this rank (links.h) */
    struct kiln_energy energy;
    struct kiln_worst_object worst;
    double texel_loss;              /* of published light, relative (parts/texel_loss.h); 0: not known */
    struct kiln_step_balance trial; /* findings and action before the first step (trial.h) */
    double trial_seconds;           /* 0: nothing was tried */
};

/* Three floats a point in direct and indirect, W/m2 about the shading normal; see field/result.h. */
struct kiln_solution {
    float *direct, *indirect; /* of own points */
    uint16_t *error;          /* likewise: kiln_error_pack */
    /* own points' data, including the three arrays above; its `sum` is `indirect` */
    const struct kiln_rank_data *own;
    struct kiln_node_data *node_data;
    struct kiln_radiosity_allgather *allgather;
    struct kiln_sight *sight; /* visibility grid; NULL: not used */
    uint64_t *radiosity;      /* of all points, packed: gathered by the step; finally the total. Owned by allgather */
    struct kiln_integrate_report report;
};

/* Returns the report of the current step, or of the last one. */
static inline struct kiln_step_report *kiln_solution_step(const struct kiln_solution *solution)
{
    return &solution->report.steps.of[solution->report.steps.count - 1];
}

/* Updates the pointers to own data, after the node's data was made or redistributed. */
void kiln_solution_refresh(struct kiln_solution *solution);

/* Collective. Releases the solution and sets the pointer to NULL, which may be NULL. */
void kiln_solution_destroy(struct kiln_solution **solution);

#endif
