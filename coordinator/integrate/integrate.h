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
struct kiln_denoising;
struct kiln_light_groups;
struct kiln_transport;

/* Background work during the steps, in threads of its own that yield to the steps. `start` is called once the own
 * points have their final place; `direct` when no step will change direct light any more; `stop`, which ends the work
 * for good, before the points move to other ranks or are released. None is collective. */
struct kiln_beside {
    void (*start)(void *context, const struct kiln_rank_data *own);
    void (*direct)(void *context);
    void (*stop)(void *context);
    void *context;
};

/* Called once, on rank 0, when the first round of a bake for an error of published light has been judged; the last of
 * the reports has what is foretold. */
struct kiln_round_listener {
    void (*first_round)(void *context, const struct kiln_step_reports *steps);
    void *context;
};

/* All pointers are borrowed. */
struct kiln_integrate_params {
    MPI_Comm communicator;
    int rank, ranks;
    double begin;       /* MPI_Wtime() when the run began */
    double after_light; /* s that the run is expected to take after its light; 0: unknown */
    double rounds;      /* samples of all rounds over those of the first, as foretold before the light; 0: unknown */
    const struct kiln_round_listener *listener; /* NULL: none */
    const struct kiln_integrate_settings *settings;
    const struct kiln_field_set *fields; /* fields that the bake keeps */
    struct kiln_backend *backend;        /* has its surface */
    struct kiln_surface *surface;        /* the solution takes over its own part: see field/rank_data.h */
    const uint16_t *seen;          /* 1 an own tile run: 0: it is not seen; NULL: all are (bake/light/visible_from.h) */
    struct kiln_node_memory *node; /* must outlive the solution */
    double area;                   /* m2, of the scene's triangles */
    const struct kiln_emission_result *emission;
    struct kiln_progress *progress;     /* may be NULL */
    struct kiln_control *control;       /* asks to save and to stop */
    struct kiln_checkpoint *checkpoint; /* an open generation is resumed; NULL: nothing is saved */
    const json_t *identity;             /* of the bake, for the checkpoints it writes */
    struct kiln_trace *trace;           /* may be NULL */
    /* all companions (companion.h), ended by NULL; NULL: none */
    const struct kiln_companion *const *companions;
    const struct kiln_light_groups *groups; /* lights kept apart by group (relight/groups.h); NULL: none */
    struct kiln_transport *transport;       /* transport to keep or replay; NULL: neither */
    uint32_t threads;                       /* threads that store the results */
    const struct kiln_beside *beside;       /* NULL: nothing */
    /* judges what lightmaps show (denoising.h); NULL: they show light as it was gathered */
    const struct kiln_denoising *denoising;
};

/* Collective. Computes the light; resumes from the open generation of the checkpoint, whatever ranks wrote it.
 * KILN_STOPPED when something asked to stop, with a new generation written; without a checkpoint nothing is written.
 * Destroy, collectively, with kiln_solution_destroy. */
int kiln_integrate(struct kiln_solution **solution, const struct kiln_integrate_params *params,
                   struct kiln_error *error);

/* Collective. Writes a checkpoint of a complete solution, with additional blocks of the caller, so that the caller's
 * later work can be resumed too. */
int kiln_integrate_save(struct kiln_solution *solution, const struct kiln_integrate_params *params,
                        const struct kiln_array_range *more, size_t count, struct kiln_error *error);

#endif
