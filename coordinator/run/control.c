#include "coordinator/run/control.h"

#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "coordinator/run/checkpoint.h"
#include "coordinator/run/lock.h"
#include "coordinator/run/status_file.h"
#include "coordinator/mpi/waiting.h"
#include "coordinator/mpi/watchdog.h"
#include "coordinator/mpi/agree.h"
#include "coordinator/files/publish.h"
#include "worker/base/memory.h"
#include "worker/base/text.h"

/* What asks to stop besides signals, whose numbers are smaller; when several do, the largest is named. */
enum { REASON_MAX_TIME = 1000, REASON_FILE };
enum { VALUE_BUSY, VALUE_STOP, VALUE_SAVE, VALUE_FAILED, VALUES };

#define COST_SHARE 50.0 /* a checkpoint after a bounce may cost one part in so many */
#define COST_START 0.02 /* s, and bytes a second, while none has been written yet */
#define COST_BYTES 300e6
#define LOOK_MS 250         /* between two looks for the file that asks to stop, on rank 0 */
#define OTHERS_LOOK_MS 1000 /* and on the others */

struct kiln_control {
    struct kiln_control_params params;
    MPI_Comm communicator; /* of its own */
    int rank, ranks;
    double monotonic_begin; /* params.begin, on that clock */
    /* the present round */
    bool posted;
    MPI_Request round;
    int64_t own[VALUES], all[VALUES];
    int reason;
    /* saving */
    double last_saved, cost;
    /* what any thread may ask */
    struct kiln_stop stop;
    atomic_int heard;        /* the reason, once there is one */
    atomic_llong next_look;  /* ms */
    pthread_mutex_t looking; /* held by who looks for the file */
    /* shared with the thread */
    pthread_t thread;
    bool thread_runs;
    pthread_mutex_t mutex;
    pthread_cond_t wake;
    bool leave;
    struct kiln_bake_status status;
    struct kiln_lock *lock; /* rank 0: of the folder */
};

static double seconds_now(clockid_t clock)
{
    struct timespec now;
    (void)clock_gettime(clock, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* ---- the thread ---- */

/* Rank 0: writes the status file once a second. A disk that stands still holds up nothing but this. */
static void *write_status(void *data)
{
    struct kiln_control *c = data;
    (void)pthread_mutex_lock(&c->mutex);
    while (!c->leave) {
        struct kiln_bake_status status = c->status;
        c->status.beat++;
        (void)pthread_mutex_unlock(&c->mutex);
        status.updated = seconds_now(CLOCK_REALTIME);
        status.seconds = status.updated - status.seconds;
        kiln_bake_status_write(c->params.directory, &status);
        kiln_lock_beat(c->lock);
        (void)pthread_mutex_lock(&c->mutex);
        struct timespec until;
        (void)clock_gettime(CLOCK_REALTIME, &until);
        until.tv_sec += 1;
        if (!c->leave)
            (void)pthread_cond_timedwait(&c->wake, &c->mutex, &until);
    }
    (void)pthread_mutex_unlock(&c->mutex);
    return NULL;
}

/* Signals are for the main thread. */
static void start_thread(struct kiln_control *c)
{
    sigset_t all, before;
    (void)sigfillset(&all);
    (void)pthread_sigmask(SIG_SETMASK, &all, &before);
    c->thread_runs = pthread_create(&c->thread, NULL, write_status, c) == 0;
    (void)pthread_sigmask(SIG_SETMASK, &before, NULL);
}

static void stop_thread(struct kiln_control *c)
{
    if (!c->thread_runs)
        return;
    (void)pthread_mutex_lock(&c->mutex);
    c->leave = true;
    (void)pthread_cond_signal(&c->wake);
    (void)pthread_mutex_unlock(&c->mutex);
    (void)pthread_join(c->thread, NULL);
    c->thread_runs = false;
}

void kiln_control_blocking(struct kiln_control *c, const char *what, double seconds)
{
    kiln_watchdog_blocking(c->params.watchdog, what, seconds);
}

/* kiln_progress_watch */
static void note_progress(void *data, const char *name, uint64_t done, uint64_t total, double left)
{
    struct kiln_control *c = data;
    (void)pthread_mutex_lock(&c->mutex);
    (void)snprintf(c->status.phase, sizeof c->status.phase, "%s", name);
    c->status.share = total > 0 ? (double)done / (double)total : -1.0;
    c->status.left = left;
    (void)pthread_mutex_unlock(&c->mutex);
}

void kiln_control_follow(struct kiln_control *c, struct kiln_progress *progress)
{
    kiln_progress_observe(progress, note_progress, c);
}

static bool asked(void *context);

/* ---- life ---- */

/* Rank 0: nobody else may be writing here. An older kiln takes no lock, but says that it is there. */
static int claim_folder(struct kiln_lock **lock, const char *directory, struct kiln_error *error)
{
    struct kiln_folder folder;
    struct kiln_bake_status before;
    int status = kiln_lock_take(lock, directory, error);
    /* a bake that was refused took the folder with it that it had made */
    for (int i = 0; i < 3 && status == KILN_NO_INPUT; i++) {
        status = kiln_make_directories(directory, error);
        if (status == KILN_OK)
            status = kiln_lock_take(lock, directory, error);
    }
    if (status == KILN_OK && kiln_bake_status_read(directory, &before, NULL) == KILN_OK &&
        kiln_bake_status_alive(directory, &before))
        status = kiln_fail(error, KILN_CANNOT_CREATE,
                           "another bake is at work in %.500s (process %lld on %s): wait for it, end it with "
                           "'kiln stop %.500s', or choose another folder",
                           directory, (long long)before.process, before.host, directory);
    if (status == KILN_OK) {
        status = kiln_folder_open(&folder, directory, "checkpoint", true, error);
        kiln_folder_close(&folder);
    }
    if (status == KILN_OK)
        kiln_stop_forget(directory);
    return status;
}

int kiln_control_create(struct kiln_control **control, const struct kiln_control_params *params,
                        struct kiln_error *error)
{
    struct kiln_control *c = NULL;
    *control = NULL;
    int status =
        kiln_agree(params->communicator, kiln_allocate(&c, 1, sizeof *c, "the control of a bake", error), error);
    if (status != KILN_OK) {
        kiln_free(&c);
        return status;
    }
    c->params = *params;
    c->round = MPI_REQUEST_NULL;
    (void)MPI_Comm_dup(params->communicator, &c->communicator);
    (void)MPI_Comm_rank(c->communicator, &c->rank);
    (void)MPI_Comm_size(c->communicator, &c->ranks);
    (void)pthread_mutex_init(&c->mutex, NULL);
    (void)pthread_cond_init(&c->wake, NULL);
    (void)pthread_mutex_init(&c->looking, NULL);
    c->stop = (struct kiln_stop){asked, c};
    c->monotonic_begin = seconds_now(CLOCK_MONOTONIC) - (MPI_Wtime() - params->begin);
    c->last_saved = MPI_Wtime();
    c->status =
        (struct kiln_bake_status){.state = "running", .phase = "start", .share = -1.0, .left = -1.0, .ranks = c->ranks};
    kiln_bake_status_sign(&c->status);
    /* when the run began; the thread makes seconds of it */
    c->status.seconds = c->status.updated - (MPI_Wtime() - params->begin);
    *control = c;
    status =
        kiln_agree(c->communicator, c->rank == 0 ? claim_folder(&c->lock, params->directory, error) : KILN_OK, error);
    if (status != KILN_OK) {
        kiln_control_destroy(control);
        return status;
    }
    if (c->rank == 0)
        start_thread(c);
    return KILN_OK;
}

void kiln_control_destroy(struct kiln_control **control)
{
    struct kiln_control *c = *control;
    if (c == NULL)
        return;
    stop_thread(c);
    kiln_lock_release(&c->lock);
    (void)MPI_Comm_free(&c->communicator);
    (void)pthread_cond_destroy(&c->wake);
    (void)pthread_mutex_destroy(&c->mutex);
    (void)pthread_mutex_destroy(&c->looking);
    kiln_free(control);
}

int kiln_control_check_folder(const struct kiln_control *c, struct kiln_error *error)
{
    return kiln_lock_check(c->lock, error);
}

static void write_last_word(struct kiln_control *c, int status, const char *message)
{
    struct kiln_bake_status last = c->status;
    (void)snprintf(last.state, sizeof last.state, "%s", status == KILN_STOPPED ? "stopped" : "failed");
    kiln_text_copy(last.message, sizeof last.message, message);
    last.code = status;
    last.updated = seconds_now(CLOCK_REALTIME);
    last.seconds = last.updated - last.seconds;
    kiln_bake_status_write(c->params.directory, &last);
}

void kiln_control_conclude(struct kiln_control *c, int status, const char *message, bool remove)
{
    stop_thread(c);
    if (c->rank != 0)
        return;
    if (kiln_lock_check(c->lock, NULL) == KILN_OK) { /* else it is another bake's by now */
        kiln_stop_forget(c->params.directory);
        if (remove) {
            kiln_bake_status_remove(c->params.directory);
            kiln_checkpoint_remove_folder(c->params.directory);
        } else {
            write_last_word(c, status, message);
        }
    }
    kiln_lock_release(&c->lock);
}

/* ---- rounds ---- */

/* What asks this rank to stop, of its signals, the clock and the file; 0: nothing. Any thread, and at most one of them
 * waits for the disk. */
static int hear(struct kiln_control *c)
{
    struct timespec now;
    int reason = atomic_load_explicit(&c->heard, memory_order_relaxed);
    if (reason != 0)
        return reason;
    reason = (int)*c->params.signal;
    (void)clock_gettime(CLOCK_MONOTONIC_COARSE, &now);
    const long long milliseconds = 1000 * (long long)now.tv_sec + now.tv_nsec / 1000000;
    if (reason == 0 && milliseconds >= atomic_load_explicit(&c->next_look, memory_order_relaxed) &&
        pthread_mutex_trylock(&c->looking) == 0) {
        if (kiln_stop_requested(c->params.directory))
            reason = REASON_FILE;
        else if (c->params.max_time > 0.0 && seconds_now(CLOCK_MONOTONIC) - c->monotonic_begin >= c->params.max_time)
            reason = REASON_MAX_TIME;
        atomic_store_explicit(&c->next_look, milliseconds + (c->rank == 0 ? LOOK_MS : OTHERS_LOOK_MS),
                              memory_order_relaxed);
        (void)pthread_mutex_unlock(&c->looking);
    }
    if (reason != 0)
        atomic_store_explicit(&c->heard, reason, memory_order_relaxed);
    return reason;
}

/* In rounds: rank 0 watches the clock and the file for all. */
static int asked_to_stop(struct kiln_control *c) { return c->rank == 0 ? hear(c) : (int)*c->params.signal; }

/* kiln_stop: where ranks work without rounds. A signal that reached this rank alone is passed on by the file that the
 * others look for. */
static bool asked(void *context)
{
    struct kiln_control *c = context;
    const bool knew = atomic_load_explicit(&c->heard, memory_order_relaxed) != 0;
    const int reason = hear(c);
    if (reason != 0 && reason < REASON_MAX_TIME && c->ranks > 1 && !knew)
        (void)kiln_stop_request(c->params.directory, NULL);
    return reason != 0;
}

const struct kiln_stop *kiln_control_stop(const struct kiln_control *c) { return &c->stop; }

/* The least is the one that is not passed on. */
void kiln_control_why(struct kiln_control *c)
{
    int reason = hear(c), least = 0;
    reason = reason != 0 ? reason : REASON_FILE + 1;
    (void)MPI_Allreduce(&reason, &least, 1, MPI_INT, MPI_MIN, c->communicator);
    c->reason = least;
}

static void post(struct kiln_control *c, bool done, int failed)
{
    const double every = c->params.checkpoint_every;
    c->own[VALUE_BUSY] = !done;
    c->own[VALUE_STOP] = asked_to_stop(c);
    c->own[VALUE_SAVE] = c->rank == 0 && every > 0.0 && MPI_Wtime() - c->last_saved >= every;
    c->own[VALUE_FAILED] = failed;
    (void)MPI_Iallreduce(c->own, c->all, VALUES, MPI_INT64_T, MPI_MAX, c->communicator, &c->round);
    c->posted = true;
}

static enum kiln_event event_of(struct kiln_control *c)
{
    if (c->all[VALUE_FAILED] != 0)
        return KILN_EVENT_FAIL;
    if (c->all[VALUE_STOP] != 0) {
        c->reason = (int)c->all[VALUE_STOP];
        return KILN_EVENT_STOP;
    }
    if (c->all[VALUE_BUSY] == 0)
        return KILN_EVENT_DONE;
    return c->all[VALUE_SAVE] != 0 ? KILN_EVENT_SAVE : KILN_EVENT_NONE;
}

void kiln_control_begin(struct kiln_control *c, const char *phase)
{
    kiln_watchdog_phase(c->params.watchdog, phase);
    kiln_watchdog_batch(c->params.watchdog, 0.0, 0.0);
}

double kiln_control_batch_seconds(const struct kiln_control *c)
{
    double seconds = 1.0;
    if (c->params.checkpoint_every > 0.0)
        seconds = fmin(seconds, c->params.checkpoint_every / 4.0);
    if (c->params.limit > 0.0)
        seconds = fmin(seconds, c->params.limit / 8.0);
    return fmax(seconds, 0.02);
}

enum kiln_event kiln_control_poll(struct kiln_control *c, bool done, double share, double batch, int failed)
{
    int complete = 0;
    kiln_watchdog_batch(c->params.watchdog, share, batch);
    if (!c->posted)
        post(c, done || failed != 0, failed);
    (void)MPI_Test(&c->round, &complete, MPI_STATUS_IGNORE);
    if (complete == 0)
        return KILN_EVENT_NONE;
    c->posted = false;
    const enum kiln_event event = event_of(c);
    if (event == KILN_EVENT_NONE)
        post(c, done || failed != 0, failed);
    else
        kiln_watchdog_rest(c->params.watchdog);
    return event;
}

enum kiln_event kiln_control_wait(struct kiln_control *c, bool done, double share, int failed,
                                  bool (*news)(void *context), void *context)
{
    struct timespec pause = {0, 10000};
    enum kiln_event event;
    kiln_waiting_begin("a wait for the end of the pass");
    for (;;) {
        event = kiln_control_poll(c, done, share, 0.0, failed);
        if (event != KILN_EVENT_NONE || (news != NULL && news(context)))
            break;
        (void)nanosleep(&pause, NULL); /* the cores may be wanted by a rank that is not done */
        if (pause.tv_nsec < 1000000)
            pause.tv_nsec += pause.tv_nsec / 2;
    }
    kiln_waiting_end();
    return event;
}

void kiln_control_meet(struct kiln_control *c)
{
    MPI_Request all;
    int here = 0;
    struct timespec pause = {0, 10000};
    if (c->ranks == 1)
        return;
    (void)MPI_Ibarrier(c->communicator, &all);
    kiln_waiting_begin("a wait for all ranks");
    for (;;) {
        (void)MPI_Test(&all, &here, MPI_STATUS_IGNORE);
        if (here != 0)
            break;
        (void)asked(c); /* a signal that reached only who waits has to reach who works */
        (void)nanosleep(&pause, NULL);
        if (pause.tv_nsec < 1000000)
            pause.tv_nsec += pause.tv_nsec / 2;
    }
    kiln_waiting_end();
}

enum kiln_event kiln_control_between(struct kiln_control *c, uint64_t bytes)
{
    const double every = c->params.checkpoint_every;
    const double cost = c->cost > 0.0 ? c->cost : COST_START + (double)bytes / COST_BYTES;
    int64_t values[2] = {asked_to_stop(c),
                         c->rank == 0 && every > 0.0 && MPI_Wtime() - c->last_saved >= fmin(every, COST_SHARE * cost)};
    kiln_control_blocking(c, "between passes", 0.0);
    (void)MPI_Allreduce(MPI_IN_PLACE, values, 2, MPI_INT64_T, MPI_MAX, c->communicator);
    kiln_control_blocking(c, NULL, 0.0);
    c->reason = (int)values[0];
    return values[0] != 0 ? KILN_EVENT_STOP : values[1] != 0 ? KILN_EVENT_SAVE : KILN_EVENT_NONE;
}

void kiln_control_saved(struct kiln_control *c, uint64_t generation, double seconds, double written)
{
    c->last_saved = MPI_Wtime();
    if (seconds > 0.0)
        c->cost = seconds;
    (void)pthread_mutex_lock(&c->mutex);
    c->status.generation = generation;
    c->status.saved = written;
    (void)pthread_mutex_unlock(&c->mutex);
}

static const char *reason_text(const struct kiln_control *c)
{
    switch (c->reason) {
    case REASON_FILE:
        return "kiln stop";
    case REASON_MAX_TIME:
        return "--max-time";
    case SIGUSR1:
        return "SIGUSR1";
    case SIGTERM:
        return "SIGTERM";
    case SIGINT:
        return "SIGINT";
    case SIGHUP:
        return "SIGHUP";
    default:
        return "a signal";
    }
}

int kiln_stopped(const struct kiln_control *c, struct kiln_error *error)
{
    return kiln_fail(error, KILN_STOPPED,
                     "stopped by %s; a checkpoint was written, and the same command goes on from it", reason_text(c));
}

int kiln_stopped_early(const struct kiln_control *c, uint64_t generation, struct kiln_error *error)
{
    if (generation == 0)
        return kiln_fail(
            error, KILN_STOPPED,
            "stopped by %s before any light was computed: there is nothing to keep, and the same command starts from "
            "the beginning",
            reason_text(c));
    return kiln_fail(error, KILN_STOPPED,
                     "stopped by %s before any more light was computed; checkpoint %llu is kept, and the same command "
                     "goes on from it",
                     reason_text(c), (unsigned long long)generation);
}
