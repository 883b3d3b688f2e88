/* The light of all surface points as the lockstep runner computes it: irradiance of this rank's points, radiosity of
 * all points, and the report of the steps. */
#ifndef KILN_COORDINATOR_INTEGRATE_SOLUTION_H
#define KILN_COORDINATOR_INTEGRATE_SOLUTION_H

#include "coordinator/field/packed_error.h"
#include "coordinator/field/radiosity_allgather.h"
#include "coordinator/field/rank_data.h"
#include "coordinator/integrate/step.h"
#include "worker/pass/visibility_cache.h"

/* The visibility grid of a bake in which nodes receive the radiosity of what their points see: made by reach/sight.h,
 * which says what a unit is. */
struct kiln_sight {
    uint64_t units;
    uint64_t *first; /* first point of each unit, and one more at the end; the same on all ranks */
    /* of the units that this rank has a part in: unit << 32 | unit that it sees, ascending, none twice */
    uint64_t *pairs;
    size_t pair_count;
    uint64_t sent;  /* bytes that this rank has sent to others, so that the grid is whole */
    double seconds; /* of this rank */
};

/* Sets the pointer to NULL, which may be NULL. */
void kiln_sight_destroy(struct kiln_sight **sight);

#define KILN_TAIL_DIVERGES (-1.0)

/* Report on the radiance probes of a bake whose gather rays end at a range. All zeros: none. The same on all ranks. */
struct kiln_radiance_report {
    bool placed;                 /* the next two and `alone` are known */
    uint64_t probes, moved, off; /* of all, those moved off the grid, and those that nobody asks */
    uint64_t rays;               /* of all steps, of this run and those before; known when all light is */
    uint64_t bytes;              /* of what all of them keep, on each rank */
    uint64_t alone;              /* surface points that see no probe: their rays have no end */
    double spacing;              /* m */
    uint32_t side, samples;      /* of a probe: elements along the side of its map; rays in each step that gathers */
};

/* Report on the light paths of a bake; all zeros: it traces none. The same on all ranks. */
struct kiln_landing_report {
    uint64_t photons; /* of an iteration: at least one for each aim */
    uint64_t aims;    /* pairs of a lamp and an object with gloss, or a part of one */
    uint32_t rays;    /* of a point, of the last step, that share its light with paths; 0: none */
    double radius;    /* m, within which they were merged at first; of the last step that did */
    uint32_t on_host; /* passes that a device has left to the host: bit KILN_PASS_INDEX_..., of this rank */
};

struct kiln_integrate_report {
    struct kiln_roles roles; /* of the steps */
    struct kiln_step_reports steps;
    uint32_t bounces;     /* indirect bounces gathered one by one or summed for the final gather */
    bool tail;            /* a geometric tail was added */
    double tail_ratio[3]; /* power of one bounce over that of the one before, at the end */
    double tail_share;    /* of all reflected power, luminance */
    /* of all light, relative: what is not known of the tail; of bounces that go on without one (the equal schedule),
     * what is left out; KILN_TAIL_DIVERGES: their sum has no end */
    double tail_error;
    double tail_object_error; /* of the object for which it is largest: kiln_step_report.object_error at the end */
    double tail_tile_error;   /* the same of the tile for which it is largest: a pocket that keeps its light for long */
    uint32_t tail_pocket;     /* that tile's object */
    uint32_t restarts;        /* how often the bake was gone on with from a checkpoint */
    double seconds_before;    /* that the earlier runs of it took up to their last checkpoint */
    double waiting_seconds;   /* of this rank, at the ends of steps: for others to be done */
    bool steals_work;         /* whether the ranks of this rank's node compute points for each other */
    uint64_t received;        /* bytes of radiosity from other nodes */
    uint64_t whole;           /* the same if nodes received the radiosity of all points */
    uint64_t computed_again;  /* points of this rank, once for each time, whose rays met what was not there */
    struct kiln_radiance_report radiance;
    struct kiln_landing_report landing;
    struct kiln_visibility_counts visibility; /* of this rank, in this run (patches.h) */
    uint64_t links, link_bytes;               /* that this rank has kept (links.h) */
    struct kiln_energy energy;
    struct kiln_step_balance trial; /* what was found before the first step (trial.h), and done */
    double trial_seconds;           /* 0: nothing was tried */
};

/* Three floats a point in direct and indirect, W/m2 about the shading normal; see field/result.h. */
struct kiln_solution {
    float *direct, *indirect; /* of own points */
    uint16_t *error;          /* likewise: kiln_error_pack */
    /* own points' data, of which the three above are a part; its `sum` is `indirect` */
    const struct kiln_rank_data *own;
    struct kiln_node_data *node_data;
    struct kiln_radiosity_allgather *allgather;
    struct kiln_sight *sight; /* what sees what; NULL: nobody asks */
    uint64_t *radiosity; /* of all points, packed: what a step gathers from; in the end the total. The allgather's */
    struct kiln_integrate_report report;
};

/* The report of the step under way, or of the last one. */
static inline struct kiln_step_report *kiln_solution_step(const struct kiln_solution *solution)
{
    return &solution->report.steps.of[solution->report.steps.count - 1];
}

/* Points the solution to the own data as the node's data has it now: after that was made or redistributed. */
void kiln_solution_refresh(struct kiln_solution *solution);

/* Collective. Releases the solution and sets the pointer to NULL, which may be NULL. */
void kiln_solution_destroy(struct kiln_solution **solution);

#endif
