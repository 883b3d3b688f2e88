#include "coordinator/run/control.h"

#include <math.h>
#include <pthread.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "coordinator/run/checkpoint.h"
#include "coordinator/run/output_folder.h"
#include "coordinator/run/process.h"
#include "coordinator/run/status_file.h"
#include "coordinator/mpi/waiting.h"
#include "coordinator/mpi/watchdog.h"
#include "coordinator/mpi/agree.h"
#include "coordinator/files/publish.h"
#include "worker/base/memory.h"
#include "worker/base/text.h"

/* Reasons to stop. A signal is represented by its number, which is smaller than these. Of several reasons the largest
 * is reported. */
enum { REASON_MAX_TIME = 1000, REASON_FILE };
enum { VALUE_BUSY, VALUE_STOP, VALUE_SAVE, VALUE_FAILED, VALUES };

#define COST_DIVISOR 50.0   /* checkpoints after bounces may take 1/50 of the time */
#define COST_START 0.02     /* predicted cost before the first checkpoint: seconds, */
#define COST_BYTES 300e6    /* plus its size at so many bytes a second */
#define LOOK_MS 250         /* interval at which rank 0 looks for the stop file */
#define OTHERS_LOOK_MS 1000 /* and the other ranks */

struct kiln_control {
    struct kiln_control_params params;
    MPI_Comm communicator; /* a duplicate, used by the control only */
    int rank, ranks;
    double monotonic_begin; /* params.begin on CLOCK_MONOTONIC */
    /* the present round */
    bool posted;
    MPI_Request round;
    int64_t own[VALUES], all[VALUES];
    int reason;
    /* saving */
    double last_saved, cost;
    char pass[64]; /* the pass under way; "": none */
    /* may be used by any thread */
    struct kiln_stop stop;
    atomic_int reason_found; /* the reason to stop; 0: none so far */
    atomic_llong next_look;  /* when to look for the stop file again, ms */
    pthread_mutex_t looking; /* held by the thread that looks for it */
    /* shared with the status thread */
    pthread_t thread;
    bool thread_runs;
    pthread_mutex_t mutex;
    pthread_cond_t wake;
    bool leave;
    struct kiln_bake_status status;
    struct kiln_output_folder *folder; /* rank 0 */
};

static double seconds_now(clockid_t clock)
{
    struct timespec now;
    (void)clock_gettime(clock, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* ---- the status thread ---- */

/* Rank 0: writes the status file once a second. A hanging disk blocks only this thread. */
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
        kiln_lock_beat(kiln_output_folder_lock(c->folder));
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

/* The thread blocks all signals, so that the main thread gets them. */
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
static void note_progress(void *data, const struct kiln_progress_state *state)
{
    struct kiln_control *c = data;
    (void)pthread_mutex_lock(&c->mutex);
    (void)snprintf(c->status.phase, sizeof c->status.phase, "%s", state->phase);
    c->status.phase_share = state->phase_share;
    c->status.share = state->share;
    c->status.left = state->left;
    (void)pthread_mutex_unlock(&c->mutex);
}

void kiln_control_follow(struct kiln_control *c, struct kiln_progress *progress)
{
    kiln_progress_observe(progress, note_progress, c);
}

static bool asked(void *context);

/* ---- create and destroy ---- */

/* Rank 0: locks the folder. Also refuses if an older kiln is at work, which takes no lock but writes a status file. */
static int claim_folder(struct kiln_output_folder **output, const char *directory, bool no_locks,
                        struct kiln_error *error)
{
    struct kiln_folder folder;
    struct kiln_bake_status before;
    const struct kiln_output_folder_params params = {
        .directory = directory, .kind = KILN_FOLDER_LOCKED, .no_locks = no_locks};
    int status = kiln_output_folder_begin(output, &params, error);
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
    c->status = (struct kiln_bake_status){
        .state = "running", .phase = "start", .phase_share = -1.0, .share = -1.0, .left = -1.0, .ranks = c->ranks};
    kiln_bake_status_sign(&c->status);
    /* here the time at which the run began; the thread turns it into seconds since then */
    c->status.seconds = c->status.updated - (MPI_Wtime() - params->begin);
    *control = c;
    status = kiln_agree(c->communicator,
                        c->rank == 0 ? claim_folder(&c->folder, params->directory, params->no_locks, error) : KILN_OK,
                        error);
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
    kiln_output_folder_end(&c->folder, false);
    (void)MPI_Comm_free(&c->communicator);
    (void)pthread_cond_destroy(&c->wake);
    (void)pthread_mutex_destroy(&c->mutex);
    (void)pthread_mutex_destroy(&c->looking);
    kiln_free(control);
}

int kiln_control_check_folder(const struct kiln_control *c, struct kiln_error *error)
{
    return kiln_lock_check(kiln_output_folder_lock(c->folder), error);
}

static void write_final_status(struct kiln_control *c, int status, const char *message)
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
    if (kiln_control_check_folder(c, NULL) == KILN_OK) { /* else another bake has taken the folder over */
        kiln_stop_forget(c->params.directory);
        if (remove) {
            kiln_bake_status_remove(c->params.directory);
            kiln_checkpoint_remove_folder(c->params.directory);
        } else {
            write_final_status(c, status, message);
        }
    }
    kiln_output_folder_end(&c->folder, false);
}

/* ---- rounds ---- */

static int last_signal(const struct kiln_control *c) { return __atomic_load_n(c->params.signal, __ATOMIC_RELAXED); }

/* The reason for this rank to stop (signal, time or stop file); 0: none. Any thread may call it, and at most one thread
 * at a time waits for the disk. */
static int stop_reason(struct kiln_control *c)
{
    struct timespec now;
    int reason = atomic_load_explicit(&c->reason_found, memory_order_relaxed);
    if (reason != 0)
        return reason;
    reason = last_signal(c);
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
        atomic_store_explicit(&c->reason_found, reason, memory_order_relaxed);
    return reason;
}

/* As stop_reason, for rounds, where only rank 0 checks the time and the stop file. */
static int reason_in_rounds(struct kiln_control *c) { return c->rank == 0 ? stop_reason(c) : last_signal(c); }

/* kiln_stop callback for phases without rounds. If a signal has reached this rank, creates the stop file, which the
 * other ranks look for. */
static bool asked(void *context)
{
    struct kiln_control *c = context;
    const bool knew = atomic_load_explicit(&c->reason_found, memory_order_relaxed) != 0;
    const int reason = stop_reason(c);
    if (reason != 0 && reason < REASON_MAX_TIME && c->ranks > 1 && !knew)
        (void)kiln_stop_request(c->params.directory, NULL);
    return reason != 0;
}

const struct kiln_stop *kiln_control_stop(const struct kiln_control *c) { return &c->stop; }

/* The smallest reason is the original one: a signal is passed on as a stop file, which has a larger number. */
void kiln_control_why(struct kiln_control *c)
{
    int reason = stop_reason(c), least = 0;
    reason = reason != 0 ? reason : REASON_FILE + 1;
    (void)MPI_Allreduce(&reason, &least, 1, MPI_INT, MPI_MIN, c->communicator);
    c->reason = least;
}

static void post(struct kiln_control *c, bool done, int failed)
{
    const double every = c->params.checkpoint_every;
    c->own[VALUE_BUSY] = !done;
    c->own[VALUE_STOP] = reason_in_rounds(c);
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
    (void)snprintf(c->pass, sizeof c->pass, "%s", phase);
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

double kiln_control_seconds_left(const struct kiln_control *c)
{
    return c->params.max_time > 0.0 ? c->params.max_time - (seconds_now(CLOCK_MONOTONIC) - c->monotonic_begin)
                                    : INFINITY;
}

enum kiln_event kiln_control_poll(struct kiln_control *c, bool done, double progress, double batch, int failed)
{
    int complete = 0;
    kiln_watchdog_batch(c->params.watchdog, progress, batch);
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

enum kiln_event kiln_control_wait(struct kiln_control *c, bool done, double progress, int failed,
                                  bool (*news)(void *context), void *context)
{
    struct timespec pause = {0, 10000};
    enum kiln_event event;
    kiln_waiting_begin("a wait for the end of the pass");
    for (;;) {
        event = kiln_control_poll(c, done, progress, 0.0, failed);
        if (event != KILN_EVENT_NONE || (news != NULL && news(context)))
            break;
        (void)nanosleep(&pause, NULL); /* sleep, since ranks that are not done may use the cores */
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
        (void)asked(c); /* pass a signal on to the ranks that still work */
        (void)nanosleep(&pause, NULL);
        if (pause.tv_nsec < 1000000)
            pause.tv_nsec += pause.tv_nsec / 2;
    }
    kiln_waiting_end();
}

double kiln_control_due_after(double checkpoint_every, double cost)
{
    return fmin(checkpoint_every, COST_DIVISOR * cost);
}

enum kiln_event kiln_control_between(struct kiln_control *c, uint64_t bytes)
{
    const double every = c->params.checkpoint_every;
    const double cost = c->cost > 0.0 ? c->cost : COST_START + (double)bytes / COST_BYTES;
    c->pass[0] = '\0';
    int64_t values[2] = {reason_in_rounds(c), c->rank == 0 && every > 0.0 &&
                                                  MPI_Wtime() - c->last_saved >= kiln_control_due_after(every, cost)};
    kiln_control_blocking(c, "between passes", 0.0);
    (void)MPI_Allreduce(MPI_IN_PLACE, values, 2, MPI_INT64_T, MPI_MAX, c->communicator);
    kiln_control_blocking(c, NULL, 0.0);
    c->reason = (int)values[0];
    return values[0] != 0 ? KILN_EVENT_STOP : values[1] != 0 ? KILN_EVENT_SAVE : KILN_EVENT_NONE;
}

/* For tests: stops this process once it has saved something within the pass that KILN_HALT_RANK names. */
static void halt_within(const struct kiln_control *c)
{
    static const char saved[] = "saved ";
    const char *halt = c->params.halt;
    if (halt != NULL && c->pass[0] != '\0' && strncmp(halt, saved, sizeof saved - 1) == 0 &&
        strcmp(halt + sizeof saved - 1, c->pass) == 0)
        (void)raise(SIGSTOP);
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
    halt_within(c);
}

static const char *reason_text(const struct kiln_control *c)
{
    switch (c->reason) {
    case REASON_FILE:
        return "kiln stop";
    case REASON_MAX_TIME:
        return "--max-time";
    default:
        return kiln_process_signal_name(c->reason);
    }
}

int kiln_stopped(const struct kiln_control *c, struct kiln_error *error)
{
    return kiln_fail(error, KILN_STOPPED,
                     "stopped by %s; a checkpoint was written, and the same command goes on from it", reason_text(c));
}

int kiln_stopped_between(const struct kiln_control *c, struct kiln_error *error)
{
    return kiln_fail(error, KILN_STOPPED,
                     "stopped by %s: what is written is whole, and the same command starts from the beginning",
                     reason_text(c));
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
