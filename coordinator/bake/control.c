#include "coordinator/bake/control.h"

#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "coordinator/bake/status_file.h"
#include "coordinator/cli/agree.h"
#include "coordinator/output/publish.h"
#include "worker/base/memory.h"

enum { TAG_BEAT = 7, HOST = 64 };
/* What asks to stop besides signals, whose numbers are smaller; when several do, the largest is named. */
enum { REASON_MAX_TIME = 1000, REASON_FILE };
enum { VALUE_BUSY, VALUE_STOP, VALUE_SAVE, VALUE_FAILED, VALUES };

#define COST_SHARE 50.0        /* a checkpoint after a bounce may cost one part in so many */
#define COST_START 0.02        /* s, and bytes a second, while none has been written yet */
#define COST_BYTES 300e6
#define FILE_LOOK_SECONDS 0.25 /* between two looks for the request to stop */

struct beat {
    double share, batch;
    char phase[48];
};

/* What another rank last said. */
struct witness {
    double seen; /* on this rank's clock */
    struct beat beat;
};

struct kiln_control {
    struct kiln_control_params params;
    MPI_Comm communicator; /* of its own */
    int rank, ranks;
    char (*hosts)[HOST]; /* every rank's, on rank 0 and the last */
    char phase[48];
    /* the present round */
    bool posted;
    MPI_Request round;
    int64_t own[VALUES], all[VALUES];
    int reason;
    /* saving */
    double last_saved, cost;
    double next_look;
    bool file_asks;
    /* signs of life */
    struct witness *witnesses;
    MPI_Request sending;
    struct beat sent;
    double next_beat, last_poll;
    /* shared with the thread */
    pthread_t thread;
    bool thread_runs;
    pthread_mutex_t mutex;
    pthread_cond_t wake;
    bool leave;
    const char *blocking;
    double blocking_until;
    struct kiln_bake_status status;
};

static double seconds_now(clockid_t clock)
{
    struct timespec now;
    (void)clock_gettime(clock, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* ---- the thread ---- */

/* Nothing of MPI may be called here, and the main thread sits in it: the process goes, and mpirun ends the others. */
static void give_up(const struct kiln_control *c)
{
    (void)fprintf(stderr, "kiln: error: rank %d on %s has waited in '%s' for other ranks beyond the watchdog's limit of %g s: one of them, or "
                  "the way to it, is lost; run the same command again\n", c->rank, c->status.host, c->blocking, c->params.watchdog);
    _exit(KILN_RANK_LOST);
}

static void *watch(void *data)
{
    struct kiln_control *c = data;
    (void)pthread_mutex_lock(&c->mutex);
    while (!c->leave) {
        if (c->blocking != NULL && seconds_now(CLOCK_MONOTONIC) > c->blocking_until)
            give_up(c);
        if (c->rank == 0) {
            struct kiln_bake_status status = c->status;
            c->status.beat++;
            (void)pthread_mutex_unlock(&c->mutex);
            status.updated = seconds_now(CLOCK_REALTIME);
            status.seconds = status.updated - status.seconds;
            kiln_bake_status_write(c->params.directory, &status);
            (void)pthread_mutex_lock(&c->mutex);
        }
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
    c->thread_runs = pthread_create(&c->thread, NULL, watch, c) == 0;
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
    if (c->params.watchdog <= 0.0)
        return;
    (void)pthread_mutex_lock(&c->mutex);
    c->blocking = what;
    c->blocking_until = seconds_now(CLOCK_MONOTONIC) + 2.0 * c->params.watchdog + seconds;
    (void)pthread_mutex_unlock(&c->mutex);
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

void kiln_control_follow(struct kiln_control *c, struct kiln_progress *progress) { kiln_progress_observe(progress, note_progress, c); }

/* ---- life ---- */

/* Rank 0: nobody else may be writing here. */
static int claim_folder(const char *directory, struct kiln_error *error)
{
    char folder[KILN_PATH_SIZE];
    struct kiln_bake_status before;
    int status = kiln_path_join(folder, directory, "checkpoint", error);
    bool busy = status == KILN_OK;
    for (int look = 0; look < 6 && busy; look++) { /* a job that is being ended may take a moment */
        const struct timespec pause = {0, look > 0 ? 100000000 : 0};
        (void)nanosleep(&pause, NULL);
        busy = kiln_bake_status_read(directory, &before, NULL) == KILN_OK && kiln_bake_status_alive(directory, &before);
    }
    if (busy)
        status = kiln_fail(error, KILN_CANNOT_CREATE, "another bake is at work in %.500s (process %lld on %s): wait for it, end it with "
                           "'kiln stop %.500s', or choose another folder", directory, (long long)before.process, before.host, directory);
    if (status == KILN_OK)
        status = kiln_make_directory(folder, error);
    if (status == KILN_OK)
        kiln_stop_forget(directory);
    return status;
}

static int learn_hosts(struct kiln_control *c, struct kiln_error *error)
{
    char own[HOST];
    memcpy(own, c->status.host, sizeof own);
    int status = kiln_allocate(&c->hosts, (size_t)c->ranks, HOST, "the ranks' hosts", error);
    if (status == KILN_OK)
        status = kiln_allocate(&c->witnesses, (size_t)c->ranks, sizeof *c->witnesses, "the ranks' signs of life", error);
    status = kiln_agree(c->communicator, status, error);
    if (status == KILN_OK)
        (void)MPI_Allgather(own, HOST, MPI_BYTE, c->hosts, HOST, MPI_BYTE, c->communicator);
    return status;
}

int kiln_control_create(struct kiln_control **control, const struct kiln_control_params *params, struct kiln_error *error)
{
    struct kiln_control *c = NULL;
    *control = NULL;
    int status = kiln_agree(params->communicator, kiln_allocate(&c, 1, sizeof *c, "the control of a bake", error), error);
    if (status != KILN_OK) {
        kiln_free(&c);
        return status;
    }
    c->params = *params;
    c->round = c->sending = MPI_REQUEST_NULL;
    (void)MPI_Comm_dup(params->communicator, &c->communicator);
    (void)MPI_Comm_rank(c->communicator, &c->rank);
    (void)MPI_Comm_size(c->communicator, &c->ranks);
    (void)pthread_mutex_init(&c->mutex, NULL);
    (void)pthread_cond_init(&c->wake, NULL);
    c->last_saved = MPI_Wtime();
    c->status = (struct kiln_bake_status){.state = "running", .phase = "start", .share = -1.0, .left = -1.0, .ranks = c->ranks};
    kiln_bake_status_sign(&c->status);
    c->status.seconds = c->status.updated - (MPI_Wtime() - params->begin); /* when the run began; the thread makes seconds of it */
    *control = c;
    status = learn_hosts(c, error);
    if (status == KILN_OK)
        status = kiln_agree(c->communicator, c->rank == 0 ? claim_folder(params->directory, error) : KILN_OK, error);
    if (status != KILN_OK) {
        kiln_control_destroy(control);
        return status;
    }
    if (c->rank == 0 || params->watchdog > 0.0)
        start_thread(c);
    return KILN_OK;
}

void kiln_control_destroy(struct kiln_control **control)
{
    struct kiln_control *c = *control;
    if (c == NULL)
        return;
    stop_thread(c);
    /* signs of life that nobody has read yet */
    (void)MPI_Barrier(c->communicator);
    if (c->witnesses != NULL)
        for (int there = 1; there != 0;) {
            MPI_Status from;
            struct beat beat;
            (void)MPI_Iprobe(MPI_ANY_SOURCE, TAG_BEAT, c->communicator, &there, &from);
            if (there != 0)
                (void)MPI_Recv(&beat, sizeof beat, MPI_BYTE, from.MPI_SOURCE, TAG_BEAT, c->communicator, MPI_STATUS_IGNORE);
        }
    if (c->sending != MPI_REQUEST_NULL)
        (void)MPI_Wait(&c->sending, MPI_STATUS_IGNORE);
    (void)MPI_Comm_free(&c->communicator);
    (void)pthread_cond_destroy(&c->wake);
    (void)pthread_mutex_destroy(&c->mutex);
    kiln_free(&c->hosts);
    kiln_free(&c->witnesses);
    kiln_free(control);
}

void kiln_control_conclude(struct kiln_control *c, int status, const char *message, bool remove)
{
    stop_thread(c);
    if (c->rank != 0)
        return;
    kiln_stop_forget(c->params.directory);
    if (remove) {
        kiln_bake_status_remove(c->params.directory);
        char folder[KILN_PATH_SIZE];
        if (kiln_path_join(folder, c->params.directory, "checkpoint", NULL) == KILN_OK)
            (void)rmdir(folder); /* unless there is something in it */
        return;
    }
    struct kiln_bake_status last = c->status;
    (void)snprintf(last.state, sizeof last.state, "%s", status == KILN_STOPPED ? "stopped" : "failed");
    (void)snprintf(last.message, sizeof last.message, "%s", message);
    last.code = status;
    last.updated = seconds_now(CLOCK_REALTIME);
    last.seconds = last.updated - last.seconds;
    kiln_bake_status_write(c->params.directory, &last);
}

/* ---- signs of life ---- */

/* Whom this rank tells, and whom it hears: all tell rank 0, which tells the last. -1: nobody. */
static int listener(const struct kiln_control *c) { return c->ranks == 1 ? -1 : c->rank == 0 ? c->ranks - 1 : 0; }

static void forgive_all(struct kiln_control *c, double now)
{
    for (int r = 0; r < c->ranks; r++)
        c->witnesses[r].seen = now;
}

static void tell(struct kiln_control *c, double now, double share, double batch)
{
    int sent = 1;
    if (listener(c) < 0 || now < c->next_beat)
        return;
    if (c->sending != MPI_REQUEST_NULL)
        (void)MPI_Test(&c->sending, &sent, MPI_STATUS_IGNORE);
    if (sent == 0)
        return; /* the one before has not left */
    c->next_beat = now + fmin(1.0, c->params.watchdog / 8.0);
    c->sent.share = share;
    c->sent.batch = batch;
    memcpy(c->sent.phase, c->phase, sizeof c->sent.phase);
    (void)MPI_Isend(&c->sent, sizeof c->sent, MPI_BYTE, listener(c), TAG_BEAT, c->communicator, &c->sending);
}

static void listen(struct kiln_control *c, double now)
{
    for (int there = 1; there != 0;) {
        MPI_Status from;
        (void)MPI_Iprobe(MPI_ANY_SOURCE, TAG_BEAT, c->communicator, &there, &from);
        if (there == 0)
            break;
        struct witness *w = &c->witnesses[from.MPI_SOURCE];
        (void)MPI_Recv(&w->beat, sizeof w->beat, MPI_BYTE, from.MPI_SOURCE, TAG_BEAT, c->communicator, MPI_STATUS_IGNORE);
        w->seen = now;
    }
    if (now - c->last_poll > fmin(1.0, c->params.watchdog / 4.0)) /* it was this rank that was away: let them speak first */
        for (int r = 0; r < c->ranks; r++)
            c->witnesses[r].seen = fmax(c->witnesses[r].seen, now - 0.5 * c->params.watchdog);
    c->last_poll = now;
}

static void judge(struct kiln_control *c, int rank, double now)
{
    const struct witness *w = &c->witnesses[rank];
    const double silent = now - w->seen;
    if (silent <= fmax(c->params.watchdog, 4.0 * w->beat.batch))
        return;
    (void)fprintf(stderr, "kiln: error: rank %d on %s has given no sign of life for %.1f s, and the others wait for it; its last one was in "
                  "'%s' at %.0f %%. The job ends; run the same command again%s\n", rank, c->hosts[rank], silent,
                  w->beat.phase[0] != '\0' ? w->beat.phase : c->phase, 100.0 * w->beat.share,
                  c->status.generation > 0 ? " to go on from the checkpoint" : "");
    (void)fflush(stderr);
    (void)MPI_Abort(c->communicator, KILN_RANK_LOST);
}

static void keep_watch(struct kiln_control *c, double share, double batch)
{
    if (c->params.watchdog <= 0.0 || c->ranks == 1)
        return;
    const double now = MPI_Wtime();
    tell(c, now, share, batch);
    if (c->rank != 0 && c->rank != c->ranks - 1)
        return;
    listen(c, now);
    for (int r = 1; c->rank == 0 && r < c->ranks; r++)
        judge(c, r, now);
    if (c->rank != 0)
        judge(c, 0, now);
}

/* ---- rounds ---- */

/* What asks this rank to stop; 0: nothing. */
static int asked_to_stop(struct kiln_control *c)
{
    const double now = MPI_Wtime();
    int reason = (int)*c->params.signal;
    if (c->rank != 0)
        return reason;
    if (now >= c->next_look) {
        c->next_look = now + FILE_LOOK_SECONDS;
        c->file_asks = c->file_asks || kiln_stop_requested(c->params.directory);
    }
    if (c->params.max_time > 0.0 && now - c->params.begin >= c->params.max_time)
        reason = REASON_MAX_TIME;
    return c->file_asks ? REASON_FILE : reason;
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
    (void)snprintf(c->phase, sizeof c->phase, "%s", phase);
    c->next_beat = 0.0;
    c->last_poll = MPI_Wtime();
    forgive_all(c, c->last_poll);
}

double kiln_control_batch_seconds(const struct kiln_control *c)
{
    double seconds = 1.0;
    if (c->params.checkpoint_every > 0.0)
        seconds = fmin(seconds, c->params.checkpoint_every / 4.0);
    if (c->params.watchdog > 0.0)
        seconds = fmin(seconds, c->params.watchdog / 8.0);
    return fmax(seconds, 0.02);
}

enum kiln_event kiln_control_poll(struct kiln_control *c, bool done, double share, double batch, int failed)
{
    int complete = 0;
    keep_watch(c, share, batch);
    if (!c->posted)
        post(c, done || failed != 0, failed);
    (void)MPI_Test(&c->round, &complete, MPI_STATUS_IGNORE);
    if (complete == 0)
        return KILN_EVENT_NONE;
    c->posted = false;
    const enum kiln_event event = event_of(c);
    if (event == KILN_EVENT_NONE)
        post(c, done || failed != 0, failed);
    return event;
}

enum kiln_event kiln_control_wait(struct kiln_control *c, bool done, double share, int failed, bool (*news)(void *context), void *context)
{
    struct timespec pause = {0, 10000};
    for (;;) {
        const enum kiln_event event = kiln_control_poll(c, done, share, 0.0, failed);
        if (event != KILN_EVENT_NONE || (news != NULL && news(context)))
            return event;
        (void)nanosleep(&pause, NULL); /* the cores may be wanted by a rank that is not done */
        if (pause.tv_nsec < 1000000)
            pause.tv_nsec += pause.tv_nsec / 2;
    }
}

void kiln_control_meet(struct kiln_control *c)
{
    MPI_Request all;
    int here = 0;
    struct timespec pause = {0, 10000};
    if (c->ranks == 1)
        return;
    c->next_beat = 0.0;
    c->last_poll = MPI_Wtime();
    forgive_all(c, c->last_poll);
    (void)MPI_Ibarrier(c->communicator, &all);
    for (;;) {
        keep_watch(c, c->sent.share, c->sent.batch);
        (void)MPI_Test(&all, &here, MPI_STATUS_IGNORE);
        if (here != 0)
            return;
        (void)nanosleep(&pause, NULL);
        if (pause.tv_nsec < 1000000)
            pause.tv_nsec += pause.tv_nsec / 2;
    }
}

enum kiln_event kiln_control_between(struct kiln_control *c, uint64_t bytes)
{
    const double every = c->params.checkpoint_every;
    const double cost = c->cost > 0.0 ? c->cost : COST_START + (double)bytes / COST_BYTES;
    int64_t values[2] = {asked_to_stop(c), c->rank == 0 && every > 0.0 && MPI_Wtime() - c->last_saved >= fmin(every, COST_SHARE * cost)};
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
    forgive_all(c, c->last_saved);
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
    default:
        return "a signal";
    }
}

int kiln_stopped(const struct kiln_control *c, struct kiln_error *error)
{
    return kiln_fail(error, KILN_STOPPED, "stopped by %s; a checkpoint was written, and the same command goes on from it", reason_text(c));
}
