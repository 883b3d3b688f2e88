/* Computes the light of all surface points by an integrator, step by step, on all ranks in lockstep. */
#ifndef KILN_COORDINATOR_INTEGRATE_INTEGRATE_H
#define KILN_COORDINATOR_INTEGRATE_INTEGRATE_H

#include <mpi.h>

#include "coordinator/integrate/integrator.h"
#include "coordinator/run/checkpoint.h"
#include "coordinator/run/control.h"
#include "coordinator/run/progress.h"
#include "coordinator/run/trace.h"

struct kiln_companion;
struct kiln_light_groups;
struct kiln_transport;

/* Work beside the steps, in threads of its own that give way to them. `start` is called when the own points are where
 * they stay; `direct` when no step will change direct light any more; `stop` before the points move to other ranks or
 * are released, and ends it for good. None is collective. */
struct kiln_beside {
    void (*start)(void *context, const struct kiln_rank_data *own);
    void (*direct)(void *context);
    void (*stop)(void *context);
    void *context;
};

/* All pointers are borrowed. */
struct kiln_integrate_params {
    MPI_Comm communicator;
    int rank, ranks;
    double begin; /* MPI_Wtime() when the run began */
    const struct kiln_integrate_settings *settings;
    const struct kiln_field_set *fields; /* that the bake keeps */
    struct kiln_backend *backend;        /* has its surface */
    struct kiln_surface *surface;        /* its own part belongs to the solution from then on: see field/rank_data.h */
    const uint16_t *seen;          /* 1 an own tile run: 0 where it is not; NULL: all are (bake/light/visible_from.h) */
    struct kiln_node_memory *node; /* must outlive the solution */
    double area;                   /* m2, of the scene's triangles */
    const struct kiln_emission_result *emission;
    struct kiln_progress *progress;     /* may be NULL */
    struct kiln_control *control;       /* what asks to save and to stop */
    struct kiln_checkpoint *checkpoint; /* an open generation is gone on from; NULL: nothing is saved */
    const json_t *identity;             /* of the bake, for the checkpoints it writes */
    struct kiln_trace *trace;           /* may be NULL */
    /* that there are (companion.h), ended by NULL; NULL: none */
    const struct kiln_companion *const *companions;
    const struct kiln_light_groups *groups; /* whose light is told apart (relight/groups.h); NULL: none */
    struct kiln_transport *transport;       /* what rays meet is kept or replayed; NULL: neither */
    uint32_t threads;                       /* that take over the answers */
    const struct kiln_beside *beside;       /* NULL: nothing */
};

/* Collective. Goes on from the open generation of the checkpoint, whatever ranks wrote it. KILN_STOPPED, with a new
 * generation written, when something asked to stop; without a checkpoint nothing is written. Destroy, collectively,
 * with kiln_solution_destroy. */
int kiln_integrate(struct kiln_solution **solution, const struct kiln_integrate_params *params,
                   struct kiln_error *error);

/* Collective. Writes a checkpoint of a solution that is complete, with more blocks of the caller's, so that what comes
 * after it can go on too. */
int kiln_integrate_save(struct kiln_solution *solution, const struct kiln_integrate_params *params,
                        const struct kiln_block *more, size_t count, struct kiln_error *error);

#endif
