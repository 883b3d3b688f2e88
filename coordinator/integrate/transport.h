/* The bounce loop: direct light, bounces in lockstep with one exchange each, a tail, one final gather. */
#ifndef KILN_COORDINATOR_INTEGRATE_TRANSPORT_H
#define KILN_COORDINATOR_INTEGRATE_TRANSPORT_H

#include <mpi.h>

#include "coordinator/run/checkpoint.h"
#include "coordinator/run/control.h"
#include "coordinator/integrate/energy.h"
#include "coordinator/field/packed_error.h"
#include "coordinator/field/rank_data.h"
#include "coordinator/field/radiosity_allgather.h"
#include "coordinator/run/trace.h"
#include "coordinator/job/job.h"
#include "coordinator/run/progress.h"

enum { KILN_BOUNCES_ALL = 254 }; /* at most so many where their number is not given */

enum kiln_pass_kind { KILN_PASS_DIRECT, KILN_PASS_BOUNCE, KILN_PASS_FINAL };

/* What was thought after a pass of the ranks' shares in the next ones, and done; the same on all ranks. */
struct kiln_pass_balance {
    bool judged, moved;
    double imbalance; /* longest work over the mean, less 1: of a rank, or of a node whose ranks help each other */
    double gain;      /* s in the passes to come, if the shares were cut anew by what the points cost */
    double cost;      /* s for moving; 0: not asked */
    uint64_t points;  /* that the rank that gets most gets, or would */
};

/* One pass, as it went; energies are the same on all ranks. */
struct kiln_pass_report {
    enum kiln_pass_kind kind;
    uint32_t bounce; /* 0: direct; 1, 2, ...; the final gather has the number it stands for */
    uint32_t samples;
    uint64_t rays;                    /* of this rank, and of earlier runs' ranks whose work it took over */
    double seconds, exchange_seconds; /* likewise: computing; waiting and exchanging */
    double device_seconds;            /* likewise: of `seconds`, what the device was busy; 0 without one */
    /* points of this rank that others of its node computed in this run, and the other way round */
    uint64_t given, taken;
    struct kiln_pass_energy energy;
    struct kiln_pass_balance balance;
};

struct kiln_transport_report {
    struct kiln_pass_report *passes; /* pass_count of them, and room for pass_room */
    size_t pass_count, pass_room;
    uint32_t bounces;       /* indirect bounces gathered one by one or summed for the final gather */
    bool tail;              /* a geometric tail was added */
    double tail_ratio[3];   /* power of one bounce over that of the one before, at the end */
    double tail_share;      /* of all reflected power, luminance */
    uint32_t restarts;      /* how often the bake was gone on with from a checkpoint */
    double seconds_before;  /* that the earlier runs of it took up to their last checkpoint */
    double waiting_seconds; /* of this rank, at the ends of passes: for others to be done */
    bool steals_work;       /* whether the ranks of this rank's node compute points for each other */
    uint64_t received;      /* bytes of radiosity from other nodes */
    struct kiln_energy energy;
};

/* This rank's share. Three floats a point in direct and indirect, W/m2 about the shading normal; see bake/result.h. */
struct kiln_transport {
    float *direct, *indirect;
    uint16_t *error;                  /* kiln_error_pack */
    struct kiln_node_data *node_data; /* whose these three are */
    uint64_t *radiosity;              /* all points: packed total radiosity; belongs to the spread */
    struct kiln_radiosity_allgather *allgather;
    struct kiln_transport_report report;
};

struct kiln_transport_params {
    MPI_Comm communicator;
    int rank, ranks;
    double begin; /* MPI_Wtime() when the run began */
    const struct kiln_job *job;
    struct kiln_backend *backend;  /* has its surface */
    struct kiln_surface *surface;  /* its own part belongs to the transport from then on: see shares.h */
    struct kiln_node_memory *node; /* borrowed; must outlive the transport */
    double area;                   /* m2, of the scene's triangles */
    const struct kiln_emission_result *emission;
    struct kiln_progress *progress;     /* may be NULL */
    struct kiln_control *control;       /* what asks to save and to stop */
    struct kiln_checkpoint *checkpoint; /* an open generation is gone on from */
    const json_t *identity;             /* of the bake, for the checkpoints it writes */
    struct kiln_trace *trace;           /* may be NULL */
    uint32_t threads;                   /* that take over the answers */
};

/* Collective. Goes on from the open generation of the checkpoint, whatever ranks wrote it. KILN_STOPPED, with a new
 * generation written, when something asked to stop. Destroy, collectively, with kiln_transport_destroy. */
int kiln_transport_run(struct kiln_transport **transport, const struct kiln_transport_params *params,
                       struct kiln_error *error);
void kiln_transport_destroy(struct kiln_transport **transport);

/* Collective. Writes a checkpoint of a transport that has ended, with more blocks of the caller's, so that what comes
 * after it can go on too. */
int kiln_transport_save(struct kiln_transport *transport, const struct kiln_transport_params *params,
                        const struct kiln_block *more, size_t count, struct kiln_error *error);

/* For tests of who helps whom: from the environment variable KILN_SLOW_RANK, R:F, rank R takes F times as long for a
 * batch (F >= 1). 0 and 1 where it is not set; KILN_USAGE when it is not understood. */
int kiln_slow_rank(uint32_t *rank, double *factor, struct kiln_error *error);

#endif
