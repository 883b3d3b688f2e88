#include "coordinator/mpi/watchdog.h"

#include <math.h>
#include <pthread.h>
#include <signal.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "coordinator/mpi/activity.h"
#include "coordinator/mpi/waiting.h"
#include "coordinator/mpi/agree.h"
#include "coordinator/mpi/assert_same.h"
#include "worker/base/memory.h"

enum { TAG_HEARTBEAT = 7, HOST = 64, PHASE = 48, CALL = 40, ABORT_SECONDS = 10 };

#define NETWORK_BYTES 10e6          /* bytes per second: a slower network is taken for lost */
#define DEADLOCK_LIMITS (1.0 / 3.0) /* all ranks may wait for each other for so many limits, */
#define DEADLOCK_LEAST 5.0          /* but at least for so many seconds */
#define DISK_LIMITS 10.0            /* limits of time that one read or write may take */

/* Report of a rank about itself. Durations are in seconds. */
struct heartbeat {
    char phase[PHASE];
    double progress; /* fraction of the pass that is done; -1: in no pass */
    double batch;    /* duration of its last batch */
    double running;  /* time since the end of that batch; 0: in no pass */
    char call[CALL]; /* MPI call in which the rank waits; valid if waits > 0 */
    double waits;    /* time in that call without progress; 0: it does not wait */
    double grace;    /* additional time that the present call may take */
    double idle;     /* time without activity and without waiting for other ranks */
    double disk;     /* time in one read or write */
    int32_t last;    /* not 0: the rank sends no further heartbeat */
};

/* The last heartbeat of a rank. */
struct peer {
    double received; /* time on this rank's clock, s */
    struct heartbeat heartbeat;
};

struct kiln_watchdog {
    MPI_Comm communicator; /* used by the thread only, and by kiln_watchdog_destroy after the thread's end */
    int rank, ranks;
    double limit, period;
    char (*hosts)[HOST];
    struct peer *peers; /* one for each rank */
    MPI_Request sending;
    struct heartbeat sent;         /* buffer of `sending` */
    double last_received;          /* when the thread last received heartbeats */
    struct kiln_activity activity; /* used by the thread */
    uint64_t steps;                /* last value of kiln_waiting.steps; it is unchanged since `steps_since` */
    double steps_since;
    const char *halt; /* for tests: the phase in which this rank stops itself; NULL: none */
    pthread_t thread;
    bool thread_runs;
    /* shared with the thread */
    pthread_mutex_t mutex;
    pthread_cond_t wake;
    bool leave;
    struct heartbeat own;
    double batch_end; /* time of the end of this rank's last batch; 0: in no pass */
    const char *blocking;
    double blocking_until, blocking_grace;
};

static double now(void)
{
    struct timespec t;
    (void)clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* ---- the thread ---- */

/* Does not return. MPI_Abort may hang because of the lost ranks; then the alarm ends this process, and mpirun ends the
 * others. */
static void end_job(const struct kiln_watchdog *w)
{
    (void)fflush(stderr);
    (void)signal(SIGALRM, SIG_DFL);
    (void)alarm(ABORT_SECONDS);
    (void)MPI_Abort(w->communicator, KILN_RANK_LOST);
    _exit(KILN_RANK_LOST);
}

/* Returns the rank that receives this rank's heartbeats: rank 0 or, for rank 0, the last rank. */
static int receiver(const struct kiln_watchdog *w) { return w->rank == 0 ? w->ranks - 1 : 0; }
/* Returns the ranks whose heartbeats this rank receives: [*first, *end). */
static void senders(const struct kiln_watchdog *w, int *first, int *end)
{
    *first = w->rank == 0 ? 1 : 0;
    *end = w->rank == 0 ? w->ranks : w->rank == w->ranks - 1 ? 1 : 0;
}

static void send_heartbeat(struct kiln_watchdog *w, const struct heartbeat *heartbeat)
{
    int sent = 1;
    if (w->sending != MPI_REQUEST_NULL)
        (void)MPI_Test(&w->sending, &sent, MPI_STATUS_IGNORE);
    if (sent == 0)
        return; /* the previous one has not been sent yet */
    w->sent = *heartbeat;
    (void)MPI_Isend(&w->sent, sizeof w->sent, MPI_BYTE, receiver(w), TAG_HEARTBEAT, w->communicator, &w->sending);
}

static void receive(struct kiln_watchdog *w, int rank)
{
    (void)MPI_Recv(&w->peers[rank].heartbeat, sizeof(struct heartbeat), MPI_BYTE, rank, TAG_HEARTBEAT, w->communicator,
                   MPI_STATUS_IGNORE);
    w->peers[rank].received = now();
}

static void receive_heartbeats(struct kiln_watchdog *w)
{
    int first, end;
    senders(w, &first, &end);
    for (int rank = first; rank < end; rank++)
        for (int there = 1; there != 0;) {
            (void)MPI_Iprobe(rank, TAG_HEARTBEAT, w->communicator, &there, MPI_STATUS_IGNORE);
            if (there != 0)
                receive(w, rank);
        }
    if (now() - w->last_received > 0.25 * w->limit + w->period) /* this process itself was stopped: give others time */
        for (int rank = first; rank < end; rank++)
            w->peers[rank].received = fmax(w->peers[rank].received, now() - 0.5 * w->limit);
    w->last_received = now();
}

/* ---- deadlock: all ranks wait for each other ---- */

/* Whether both ranks wait in the same call of the same phase. */
static bool is_same_place(const struct heartbeat *a, const struct heartbeat *b)
{
    return strcmp(a->call, b->call) == 0 && strcmp(a->phase, b->phase) == 0;
}

static int count_same_place(const struct kiln_watchdog *w, int rank)
{
    int count = 0;
    for (int r = 0; r < w->ranks; r++)
        count += is_same_place(&w->peers[r].heartbeat, &w->peers[rank].heartbeat);
    return count;
}

/* Returns the first rank from `after` on that is the lowest one in its place, among places with `fewest` to `most`
 * ranks; -1: none. */
static int next_place(const struct kiln_watchdog *w, int after, int fewest, int most)
{
    for (int r = after; r < w->ranks; r++) {
        int same = 0;
        while (!is_same_place(&w->peers[same].heartbeat, &w->peers[r].heartbeat))
            same++;
        const int count = same == r ? count_same_place(w, r) : 0;
        if (count >= fewest && count <= most)
            return r;
    }
    return -1;
}

static void print_place(const struct kiln_watchdog *w, int rank, const char *before)
{
    const struct heartbeat *heartbeat = &w->peers[rank].heartbeat;
    const int others = count_same_place(w, rank) - 1;
    (void)fprintf(stderr, "%srank %d on %s", before, rank, w->hosts[rank]);
    if (others > 0)
        (void)fprintf(stderr, " and %d other%s", others, others == 1 ? "" : "s");
    (void)fprintf(stderr, " in %s ('%s')", heartbeat->call, heartbeat->phase);
}

/* Prints the places where ranks wait. Those with the fewest ranks come first, since these ranks have probably gone
 * wrong. */
static void print_deadlock(const struct kiln_watchdog *w, double seconds)
{
    enum { PLACES = 6 };
    int printed = 0;
    (void)fprintf(stderr,
                  "kiln: error: all ranks wait for each other, and none has made progress for %.0f s:", seconds);
    for (int size = 1; size <= w->ranks && printed < PLACES; size++)
        for (int r = next_place(w, 0, size, size); r >= 0 && printed < PLACES; r = next_place(w, r + 1, size, size))
            print_place(w, r, printed++ == 0 ? " " : "; ");
    (void)fprintf(stderr, ". The job ends; run the same command again, and report it if it happens again\n");
}

/* Rank 0: ends the job in a deadlock. A rank whose last heartbeat is old may have made progress since, so check_rank
 * decides about it, by the age of that heartbeat. */
static void check_deadlock(struct kiln_watchdog *w)
{
    double least = INFINITY, grace = 0.0;
    for (int r = 0; r < w->ranks; r++) {
        const struct heartbeat *heartbeat = &w->peers[r].heartbeat;
        if (heartbeat->last != 0 || !(heartbeat->waits > 0.0) || now() - w->peers[r].received > 3.0 * w->period + 1.0)
            return;
        least = fmin(least, heartbeat->waits);
        grace = fmax(grace, heartbeat->grace);
    }
    if (least <= fmax(DEADLOCK_LEAST, DEADLOCK_LIMITS * w->limit) + grace)
        return;
    print_deadlock(w, least);
    end_job(w);
}

/* ---- single ranks ---- */

/* Ends the job if the last heartbeat of `rank` is too old, or shows that the rank makes no progress. */
static void check_rank(const struct kiln_watchdog *w, int rank)
{
    const struct heartbeat *heartbeat = &w->peers[rank].heartbeat;
    const double silent = now() - w->peers[rank].received;
    if (heartbeat->last != 0)
        return;
    if (silent > w->limit)
        (void)fprintf(stderr,
                      "kiln: error: rank %d on %s has given no sign of life for %.1f s, and the others wait for it; "
                      "its last one was in "
                      "'%s'",
                      rank, w->hosts[rank], silent, heartbeat->phase);
    else if (heartbeat->running > fmax(w->limit, 4.0 * heartbeat->batch))
        (void)fprintf(stderr,
                      "kiln: error: rank %d on %s has not finished its batch of work for %.1f s, and the others wait "
                      "for it; it is in '%s'",
                      rank, w->hosts[rank], heartbeat->running, heartbeat->phase);
    else if (heartbeat->idle > w->limit)
        (void)fprintf(stderr,
                      "kiln: error: rank %d on %s has neither computed nor read nor written nor waited for other ranks "
                      "for %.1f s; it is in '%s'",
                      rank, w->hosts[rank], heartbeat->idle, heartbeat->phase);
    else if (heartbeat->disk > DISK_LIMITS * w->limit)
        (void)fprintf(stderr, "kiln: error: rank %d on %s has waited for a disk for %.1f s; it is in '%s'", rank,
                      w->hosts[rank], heartbeat->disk, heartbeat->phase);
    else
        return;
    if (heartbeat->progress >= 0.0)
        (void)fprintf(stderr, " at %.0f %%", 100.0 * heartbeat->progress);
    (void)fprintf(stderr, ". The job ends; run the same command again\n");
    end_job(w);
}

static void check_others(struct kiln_watchdog *w)
{
    int first, end;
    senders(w, &first, &end);
    if (end == first)
        return;
    receive_heartbeats(w);
    for (int rank = first; rank < end; rank++)
        check_rank(w, rank);
    if (w->rank == 0)
        check_deadlock(w);
}

/* Ends the job because a call has exceeded its deadline. This rank cannot tell which rank it waits for. */
static void end_overdue(const struct kiln_watchdog *w, const char *what)
{
    (void)fprintf(stderr,
                  "kiln: error: rank %d on %s has waited in '%s' for other ranks beyond the watchdog's limit of %g s: "
                  "one of them, or "
                  "the network to it, is lost; run the same command again\n",
                  w->rank, w->hosts[w->rank], what, w->limit);
    end_job(w);
}

static void set_phase(struct heartbeat *heartbeat, const char *phase)
{
    (void)snprintf(heartbeat->phase, sizeof heartbeat->phase, "%s", phase);
    heartbeat->progress = -1.0;
}

/* Adds what the process waits for, and how long it has been idle. */
static void add_activity(struct kiln_watchdog *w, struct heartbeat *heartbeat, double time)
{
    struct kiln_waiting waiting;
    kiln_waiting_look(&waiting);
    kiln_activity_sample(&w->activity, time);
    if (waiting.call == NULL || waiting.steps != w->steps)
        w->steps_since = time;
    w->steps = waiting.steps;
    heartbeat->disk = kiln_activity_disk(&w->activity);
    if (waiting.call != NULL && !(heartbeat->disk > 0.0)) {
        (void)snprintf(heartbeat->call, sizeof heartbeat->call, "%s", waiting.call);
        heartbeat->waits = time - w->steps_since;
        heartbeat->grace += (double)waiting.bytes / NETWORK_BYTES;
    }
    /* within a pass `running` counts instead, since a GPU may be computing */
    if (waiting.call == NULL && !(heartbeat->running > 0.0))
        heartbeat->idle = kiln_activity_idle(&w->activity);
}

static void *run(void *data)
{
    struct kiln_watchdog *w = data;
    (void)pthread_mutex_lock(&w->mutex);
    while (!w->leave) {
        const double time = now();
        struct heartbeat heartbeat = w->own;
        heartbeat.running = w->batch_end > 0.0 ? time - w->batch_end : 0.0;
        if (w->blocking != NULL) {
            set_phase(&heartbeat, w->blocking);
            heartbeat.grace = w->blocking_grace;
        }
        const char *overdue = w->blocking != NULL && time > w->blocking_until ? w->blocking : NULL;
        (void)pthread_mutex_unlock(&w->mutex);
        if (overdue != NULL)
            end_overdue(w, overdue);
        add_activity(w, &heartbeat, time);
        send_heartbeat(w, &heartbeat);
        w->peers[w->rank] = (struct peer){.received = time, .heartbeat = heartbeat};
        check_others(w);
        struct timespec until;
        (void)clock_gettime(CLOCK_REALTIME, &until);
        const double end = (double)until.tv_nsec * 1e-9 + w->period;
        until.tv_sec += (time_t)end;
        until.tv_nsec = (long)((end - floor(end)) * 1e9);
        (void)pthread_mutex_lock(&w->mutex);
        if (!w->leave)
            (void)pthread_cond_timedwait(&w->wake, &w->mutex, &until);
    }
    (void)pthread_mutex_unlock(&w->mutex);
    return NULL;
}

/* The thread blocks all signals, so that the main thread gets them. */
static int start_thread(struct kiln_watchdog *w, struct kiln_error *error)
{
    sigset_t all, before;
    (void)sigfillset(&all);
    (void)pthread_sigmask(SIG_SETMASK, &all, &before);
    w->thread_runs = pthread_create(&w->thread, NULL, run, w) == 0;
    (void)pthread_sigmask(SIG_SETMASK, &before, NULL);
    return w->thread_runs ? KILN_OK
                          : kiln_fail(error, KILN_SYSTEM,
                                      "no thread can be started for the watchdog: raise the limit of processes");
}

static void stop_thread(struct kiln_watchdog *w)
{
    if (!w->thread_runs)
        return;
    (void)pthread_mutex_lock(&w->mutex);
    w->leave = true;
    (void)pthread_cond_signal(&w->wake);
    (void)pthread_mutex_unlock(&w->mutex);
    (void)pthread_join(w->thread, NULL);
}

/* ---- life ---- */

/* Collective. */
static int gather_hosts(struct kiln_watchdog *w, struct kiln_error *error)
{
    char own[HOST] = "";
    (void)gethostname(own, sizeof own - 1);
    int status = kiln_allocate(&w->hosts, (size_t)w->ranks, HOST, "the ranks' hosts", error);
    if (status == KILN_OK)
        status = kiln_allocate(&w->peers, (size_t)w->ranks, sizeof *w->peers, "the ranks' heartbeats", error);
    status = kiln_agree(w->communicator, status, error);
    if (status == KILN_OK)
        (void)MPI_Allgather(own, HOST, MPI_BYTE, w->hosts, HOST, MPI_BYTE, w->communicator);
    return status;
}

/* For tests: stops this process in the phase that KILN_HALT_RANK names. */
static void halt_at(const struct kiln_watchdog *w, const char *place)
{
    if (w->halt != NULL && strcmp(w->halt, place) == 0)
        (void)raise(SIGSTOP);
}

static void begin_watch(struct kiln_watchdog *w)
{
    w->own = (struct heartbeat){.phase = "start", .progress = -1.0};
    w->last_received = now();
    for (int rank = 0; rank < w->ranks; rank++)
        w->peers[rank] = (struct peer){.received = w->last_received, .heartbeat = w->own};
}

static void free_all(struct kiln_watchdog **watchdog)
{
    struct kiln_watchdog *w = *watchdog;
    (void)MPI_Comm_free(&w->communicator);
    (void)pthread_cond_destroy(&w->wake);
    (void)pthread_mutex_destroy(&w->mutex);
    kiln_free(&w->hosts);
    kiln_free(&w->peers);
    kiln_free(watchdog);
}

/* Whether the watchdog can run. The result is the same on all ranks, since all have the same MPI library and limit. */
static bool is_possible(MPI_Comm communicator, double limit)
{
    int rank, ranks, level;
    (void)MPI_Comm_rank(communicator, &rank);
    (void)MPI_Comm_size(communicator, &ranks);
    (void)MPI_Query_thread(&level);
    if (limit <= 0.0 || ranks == 1)
        return false;
    if (level < MPI_THREAD_MULTIPLE && rank == 0)
        (void)fprintf(stderr,
                      "kiln: warning: there is no watchdog, since this MPI library does not let several threads "
                      "call it (MPI_THREAD_MULTIPLE)\n");
    return level >= MPI_THREAD_MULTIPLE;
}

int kiln_watchdog_create(struct kiln_watchdog **watchdog, MPI_Comm communicator, double limit, const char *halt,
                         struct kiln_error *error)
{
    struct kiln_watchdog *w = NULL;
    *watchdog = NULL;
    kiln_assert_same_bytes(communicator, &limit, sizeof limit, "the watchdog's limit");
    if (!is_possible(communicator, limit)) {
        (void)alarm(0);
        return KILN_OK;
    }
    int status = kiln_agree(communicator, kiln_allocate(&w, 1, sizeof *w, "the watchdog", error), error);
    if (status != KILN_OK) {
        kiln_free(&w);
        return status;
    }
    w->limit = limit;
    w->halt = halt;
    w->period = fmin(1.0, limit / 8.0);
    w->sending = MPI_REQUEST_NULL;
    (void)MPI_Comm_dup(communicator, &w->communicator);
    (void)MPI_Comm_rank(w->communicator, &w->rank);
    (void)MPI_Comm_size(w->communicator, &w->ranks);
    (void)pthread_mutex_init(&w->mutex, NULL);
    (void)pthread_cond_init(&w->wake, NULL);
    status = gather_hosts(w, error);
    if (status == KILN_OK) {
        begin_watch(w);
        status = start_thread(w, error);
        status = kiln_agree(communicator, status, error);
        if (status == KILN_OK) {
            (void)alarm(0); /* see kiln_watchdog_start */
            *watchdog = w;
            return KILN_OK;
        }
    }
    stop_thread(w);
    free_all(&w);
    return status;
}

/* ---- deadlines before and after the watchdog: alarm(2), without MPI ---- */

static char start_text[300]; /* global, since a signal handler has no other argument */

static void end_start(int number)
{
    (void)number;
    (void)!write(STDERR_FILENO, start_text, strlen(start_text));
    _exit(KILN_RANK_LOST);
}

void kiln_watchdog_start(int rank, double seconds)
{
    char host[HOST] = "";
    if (!(seconds > 0.0))
        return;
    (void)gethostname(host, sizeof host - 1);
    (void)snprintf(start_text, sizeof start_text,
                   "kiln: error: rank %d on %s has waited for the other ranks for %.0f s, and they have not all "
                   "started: one of them is lost or runs something else; give all ranks the same command and run it "
                   "again\n",
                   rank, host, ceil(seconds));
    (void)signal(SIGALRM, end_start);
    (void)alarm((unsigned)fmin(ceil(seconds), 1e6));
}

static void end_now(int number)
{
    static const char text[] = "kiln: error: the job does not come to its end within the watchdog's limit: a rank, or "
                               "the network to it, is lost; the files that the bake's manifest names are complete\n";
    (void)number;
    (void)!write(STDERR_FILENO, text, sizeof text - 1);
    _exit(KILN_RANK_LOST);
}

/* Destroys the watchdog. First it receives each sender's last heartbeat, so that no message is pending when the
 * communicator is freed. */
void kiln_watchdog_destroy(struct kiln_watchdog **watchdog)
{
    struct kiln_watchdog *w = *watchdog;
    int first, end;
    if (w == NULL)
        return;
    kiln_watchdog_phase(w, "end");
    (void)MPI_Barrier(w->communicator);
    stop_thread(w);
    (void)MPI_Wait(&w->sending, MPI_STATUS_IGNORE);
    w->sent = (struct heartbeat){.last = 1};
    (void)MPI_Isend(&w->sent, sizeof w->sent, MPI_BYTE, receiver(w), TAG_HEARTBEAT, w->communicator, &w->sending);
    senders(w, &first, &end);
    for (int rank = first; rank < end; rank++)
        while (w->peers[rank].heartbeat.last == 0)
            receive(w, rank);
    (void)MPI_Wait(&w->sending, MPI_STATUS_IGNORE);
    (void)signal(SIGALRM, end_now);
    (void)alarm((unsigned)fmin(ceil(w->limit), 1e6));
    halt_at(w, "MPI's end");
    *watchdog = NULL;
    free_all(&w);
}

/* ---- called by the main thread ---- */

void kiln_watchdog_phase(struct kiln_watchdog *w, const char *phase)
{
    if (w == NULL)
        return;
    (void)pthread_mutex_lock(&w->mutex);
    set_phase(&w->own, phase);
    w->batch_end = 0.0;
    (void)pthread_mutex_unlock(&w->mutex);
    halt_at(w, phase);
}

void kiln_watchdog_batch(struct kiln_watchdog *w, double progress, double seconds)
{
    if (w == NULL)
        return;
    (void)pthread_mutex_lock(&w->mutex);
    w->own.progress = progress;
    w->own.batch = seconds;
    w->batch_end = now();
    (void)pthread_mutex_unlock(&w->mutex);
}

void kiln_watchdog_rest(struct kiln_watchdog *w)
{
    if (w == NULL)
        return;
    (void)pthread_mutex_lock(&w->mutex);
    w->batch_end = 0.0;
    (void)pthread_mutex_unlock(&w->mutex);
}

void kiln_watchdog_blocking(struct kiln_watchdog *w, const char *what, double seconds)
{
    if (w == NULL)
        return;
    (void)pthread_mutex_lock(&w->mutex);
    w->blocking = what;
    w->blocking_until = now() + 2.0 * w->limit + seconds;
    w->blocking_grace = seconds;
    (void)pthread_mutex_unlock(&w->mutex);
    if (what != NULL)
        halt_at(w, what);
}
