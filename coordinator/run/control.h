/* Run control: the ranks of a bake decide together when to save a checkpoint, to stop, and to end a pass, while each of
 * them keeps computing.
 *
 * A rank calls kiln_control_poll between two batches of work (about a second apart) and while it waits for other ranks.
 * The calls drive a chain of non-blocking all-reduces, called rounds. In each round a rank contributes whether it is
 * done, whether it was asked to stop, and whether it has failed. When a round completes, all ranks hold the same result
 * and take the same decision. No rank waits for a round to complete. A pass ends with the first round in which all
 * ranks are done. So a signal need not reach all ranks, and may reach a rank twice.
 *
 * A bake is asked to stop by SIGUSR1, SIGTERM, SIGINT or SIGHUP on any rank, by the file that `kiln stop` creates, and
 * by
 * --max-time. Within passes rank 0 checks the file and the time, and the rounds distribute the request. In phases
 * without rounds (import, BVH, surface, files) each rank checks for itself through kiln_control_stop and gives up with
 * KILN_STOPPED; the other ranks check too, and learn of the stop when the ranks agree on the errors of that phase.
 *
 * The watchdog (watchdog.h) finds hanging and lost ranks. The control reports the phase and progress of the rank to it.
 *
 * A thread of rank 0 writes the status file (status_file.h). */
#ifndef KILN_COORDINATOR_RUN_CONTROL_H
#define KILN_COORDINATOR_RUN_CONTROL_H

#include <mpi.h>
#include <signal.h>
#include <stdbool.h>
#include <stdint.h>

#include "coordinator/mpi/watchdog.h"
#include "coordinator/run/progress.h"
#include "worker/base/stop.h"

struct kiln_control_params {
    MPI_Comm communicator;
    const char *directory;               /* folder of the bake; borrowed */
    double begin;                        /* MPI_Wtime() at the begin of the run, from which --max-time counts */
    double max_time;                     /* s; 0: none */
    double checkpoint_every;             /* s; 0: a checkpoint is written only when the bake is stopped */
    struct kiln_watchdog *watchdog;      /* borrowed, must outlive the control; NULL: none */
    double limit;                        /* limit of the watchdog, s; 0: none */
    bool no_locks;                       /* for tests: argument of kiln_lock_take */
    const char *halt;                    /* for tests: with "saved PASS" this rank stops itself (SIGSTOP) after saving a
                                            checkpoint within that pass; NULL, other text: ignored; borrowed */
    const volatile sig_atomic_t *signal; /* number of the last signal that asks to stop; 0: none */
};

enum kiln_event {
    KILN_EVENT_NONE, /* continue */
    KILN_EVENT_SAVE, /* all ranks: write a checkpoint, then continue */
    KILN_EVENT_STOP, /* all ranks: write a checkpoint, then end */
    KILN_EVENT_FAIL, /* a rank has failed: end */
    KILN_EVENT_DONE  /* all ranks are done */
};

struct kiln_control;

/* Collective. Makes the folder of the bake and locks it (output_folder.h); KILN_CANNOT_CREATE when another bake is at
 * work there. Removes a stop request that is left from an earlier run. Destroy with kiln_control_destroy. */
int kiln_control_create(struct kiln_control **control, const struct kiln_control_params *params,
                        struct kiln_error *error);
/* Collective. */
void kiln_control_destroy(struct kiln_control **control);

/* Rank 0: makes the status file show the phase and progress of `progress`, which is borrowed until the control is
 * destroyed and may be NULL. */
void kiln_control_follow(struct kiln_control *control, struct kiln_progress *progress);

/* Begins a pass called `phase` (copied). Not collective, but every rank must call it. */
void kiln_control_begin(struct kiln_control *control, const char *phase);
/* Seconds that a batch should take: one, or less when checkpoints or heartbeats are wanted more often. */
double kiln_control_batch_seconds(const struct kiln_control *control);
/* Seconds left until --max-time; INFINITY without it. */
double kiln_control_seconds_left(const struct kiln_control *control);
/* Returns without waiting the event to which this rank must react now. All ranks get the same events in the same order.
 * `done`: this rank has no more work in the pass. `progress`: completed fraction of its work, 0 to 1. `batch`: seconds
 * of its last batch. `failed`: its status; any but KILN_OK ends the pass on all ranks. */
enum kiln_event kiln_control_poll(struct kiln_control *control, bool done, double progress, double batch, int failed);
/* Waits, asleep, for the next event; for a rank that has nothing to compute. Parameters as in kiln_control_poll. If
 * `news` (may be NULL) returns true, as there is something to compute or to report, it returns KILN_EVENT_NONE. */
enum kiln_event kiln_control_wait(struct kiln_control *control, bool done, double progress, int failed,
                                  bool (*news)(void *context), void *context);

/* Collective. Barrier in which waiting ranks sleep; they forward a signal to the ranks that still work. Call it after
 * work that takes ranks different times, before a call with a deadline of kiln_control_blocking. */
void kiln_control_meet(struct kiln_control *control);

/* Interval in seconds after which a checkpoint between passes is due: --checkpoint-every, or fifty times the predicted
 * cost of a checkpoint if that is less. So checkpoints after bounces take at most 2 % of the time. */
double kiln_control_due_after(double checkpoint_every, double cost);

/* Collective. To be called between passes; returns KILN_EVENT_NONE, _SAVE (when one is due) or _STOP. `bytes` is the
 * size of a checkpoint, of all ranks together. */
enum kiln_event kiln_control_between(struct kiln_control *control, uint64_t bytes);

/* Records that checkpoint `generation` exists. `seconds`: duration of writing on this rank. `written`: time of writing,
 * seconds since 1970. */
void kiln_control_saved(struct kiln_control *control, uint64_t generation, double seconds, double written);

/* Calls kiln_watchdog_blocking. */
void kiln_control_blocking(struct kiln_control *control, const char *what, double seconds);

/* The stop request for phases outside of passes; valid as long as the control. If a signal has reached one rank only,
 * that rank creates the same file as `kiln stop`; the others see it within about a second, or whatever time their file
 * system takes. */
const struct kiln_stop *kiln_control_stop(const struct kiln_control *control);

/* Collective. Finds the source of the stop request (signal, `kiln stop`, --max-time), for the messages below. To be
 * called after a phase that all ranks left with KILN_STOPPED. */
void kiln_control_why(struct kiln_control *control);

/* Returns KILN_STOPPED with a message that names the source of the stop request ("SIGUSR1", "kiln stop", "--max-time")
 * and says that a checkpoint has been written. */
int kiln_stopped(const struct kiln_control *control, struct kiln_error *error);

/* Returns KILN_STOPPED with a message for a run that has written no checkpoint. `generation`: the checkpoint from which
 * the bake continued; 0: none. */
int kiln_stopped_early(const struct kiln_control *control, uint64_t generation, struct kiln_error *error);

/* Returns KILN_STOPPED with a message for kiln relight, which keeps only complete results, its states. */
int kiln_stopped_between(const struct kiln_control *control, struct kiln_error *error);

/* Rank 0, before results are replaced: checks that this bake still holds the lock of the folder (kiln_lock_check). */
int kiln_control_check_folder(const struct kiln_control *control, struct kiln_error *error);

/* Rank 0: writes the final state to the status file, or removes the file with `remove`; then ends the use of the
 * folder. Call it before kiln_control_destroy. */
void kiln_control_conclude(struct kiln_control *control, int status, const char *message, bool remove);

#endif
