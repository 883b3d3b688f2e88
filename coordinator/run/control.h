/* How the ranks of a bake agree to stop, to save and to end a pass together while each of them computes on.
 *
 * Between two batches of work (about a second apart) and while it waits for others, a rank calls kiln_control_poll.
 * That drives a chain of non-blocking all-reduces, the rounds: each rank puts in whether it is done, whether it was
 * asked to stop and whether it has failed; when a round is complete all ranks hold the same answer and do the same.
 * Nobody waits in a round, and a pass ends with the first round in which all are done. A signal therefore need not
 * reach all ranks, and reaching one twice does no harm.
 *
 * What asks to stop: SIGUSR1, SIGTERM, SIGINT, SIGHUP on any rank; the file that `kiln stop` leaves, and --max-time. In
 * passes rank 0 looks for these two and the rounds spread the word. Where ranks work on without rounds (import, BVH,
 * surface, files) each looks for itself, through kiln_control_stop, gives up with KILN_STOPPED, and the agreement on
 * that phase's errors tells the others, which have looked too.
 *
 * Who has fallen silent is the watchdog's business (watchdog.h), which is told here where a rank stands.
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
    const char *directory;               /* of the bake; borrowed */
    double begin;                        /* MPI_Wtime() when the run began: --max-time counts from there */
    double max_time;                     /* s; 0: none */
    double checkpoint_every;             /* s; 0: no checkpoints but when stopped */
    struct kiln_watchdog *watchdog;      /* borrowed, and outlives the control; NULL: none */
    double limit;                        /* s, the watchdog's; 0: none */
    const volatile sig_atomic_t *signal; /* number of the last signal that asks to stop; 0: none */
};

enum kiln_event {
    KILN_EVENT_NONE, /* go on */
    KILN_EVENT_SAVE, /* all ranks: write a checkpoint, then go on */
    KILN_EVENT_STOP, /* all ranks: write a checkpoint, then end */
    KILN_EVENT_FAIL, /* a rank has failed: end */
    KILN_EVENT_DONE  /* all ranks are done */
};

struct kiln_control;

/* Collective. KILN_CANNOT_CREATE when another bake is at work in the folder. A request to stop that is still there from
 * before is forgotten. Destroy with kiln_control_destroy. */
int kiln_control_create(struct kiln_control **control, const struct kiln_control_params *params,
                        struct kiln_error *error);
/* Collective. */
void kiln_control_destroy(struct kiln_control **control);

/* Rank 0: lets the status file follow a progress line (which may be NULL; borrowed until destroyed). */
void kiln_control_follow(struct kiln_control *control, struct kiln_progress *progress);

/* Begins a pass called `phase` (copied). Not collective, but every rank does. */
void kiln_control_begin(struct kiln_control *control, const char *phase);
/* How long a batch should take: a second, or less where checkpoints or signs of life are wanted oftener. */
double kiln_control_batch_seconds(const struct kiln_control *control);
/* What to do now. `done`: this rank has nothing more to do in the pass. `share` of it is done, `batch` is the seconds
 * that its last batch took. `failed`: its status. Returns at once; everybody gets the same events in the same order. */
enum kiln_event kiln_control_poll(struct kiln_control *control, bool done, double share, double batch, int failed);
/* The same for a rank that has nothing to compute: waits for an event or, KILN_EVENT_NONE, until `news` (which may be
 * NULL) says that the rank has something to do, or to say. */
enum kiln_event kiln_control_wait(struct kiln_control *control, bool done, double share, int failed,
                                  bool (*news)(void *context), void *context);

/* Collective. Waits until all ranks are here, asleep most of the time, and passes a signal on to those that still work:
 * to be called where work of unequal length lies before a call that kiln_control_blocking gives a limit. */
void kiln_control_meet(struct kiln_control *control);

/* Collective. Between passes: KILN_EVENT_NONE, _SAVE or _STOP. Saving `bytes` (of all ranks) is due when the time since
 * the last checkpoint is
 * --checkpoint-every, or fifty times what it will cost: so it happens after a bounce, and costs no more than two parts
 * in a hundred. */
enum kiln_event kiln_control_between(struct kiln_control *control, uint64_t bytes);

/* A checkpoint was written (or, with generation, found): seconds it took. */
void kiln_control_saved(struct kiln_control *control, uint64_t generation, double seconds, double written);

/* kiln_watchdog_blocking. */
void kiln_control_blocking(struct kiln_control *control, const char *what, double seconds);

/* What asks to stop outside passes; lives as long as the control. A signal that has reached one rank only becomes known
 * to the others through the same file as `kiln stop` leaves: within about a second, or what their file system takes to
 * show it. */
const struct kiln_stop *kiln_control_stop(const struct kiln_control *control);

/* Collective. After a phase that all ranks left with KILN_STOPPED: learns why, for the sentences below. */
void kiln_control_why(struct kiln_control *control);

/* KILN_STOPPED with its sentence: what asked to stop ("SIGUSR1", "kiln stop", "--max-time"), once a checkpoint is
 * written. */
int kiln_stopped(const struct kiln_control *control, struct kiln_error *error);

/* The same when nothing was written: `generation` is that of the checkpoint which the bake went on from, 0: none. */
int kiln_stopped_early(const struct kiln_control *control, uint64_t generation, struct kiln_error *error);

/* Rank 0, before results are replaced: whether the folder is still this bake's (kiln_lock_check). */
int kiln_control_check_folder(const struct kiln_control *control, struct kiln_error *error);

/* Rank 0: the last word in the status file; with `remove` the file goes instead; then the folder is given free. Call it
 * before kiln_control_destroy. */
void kiln_control_conclude(struct kiln_control *control, int status, const char *message, bool remove);

#endif
