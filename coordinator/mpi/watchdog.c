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
#include "worker/base/memory.h"

enum { TAG_SIGN = 7, HOST = 64, PHASE = 48, CALL = 40, ABORT_SECONDS = 10 };

#define NETWORK_BYTES 10e6         /* a second, at the slowest network that is not taken for a dead one */
#define PATIENCE_SHARE (1.0 / 3.0) /* of the limit, while all ranks wait for each other */
#define PATIENCE_LEAST 5.0         /* s */
#define DISK_LIMITS 10.0           /* limits that a disk may take for one read or write */

/* What a rank says of itself. */
struct sign {
    char phase[PHASE];
    double share;    /* of a pass */
    double batch;    /* s, its last one */
    double away;     /* s since it came back from that; 0: it is in no pass */
    char call[CALL]; /* it waits for others in, when it does */
    double waits;    /* s without a step forward there; 0: it does not wait */
    double grace;    /* s more that the present call may take */
    double idle;     /* s in which it has done nothing at all, nor waited for others */
    double disk;     /* s in one read or write */
    int32_t last;    /* no other will come */
};

struct witness {
    double seen; /* on this rank's clock */
    struct sign sign;
};

struct kiln_watchdog {
    MPI_Comm communicator; /* the thread's own, but for kiln_watchdog_destroy after its end */
    int rank, ranks;
    double limit, period;
    char (*hosts)[HOST];
    struct witness *witnesses;
    MPI_Request sending;
    struct sign sent;
    double last_look;
    struct kiln_activity activity; /* the thread's */
    uint64_t steps;                /* kiln_waiting.steps, since `still` */
    double still;
    const char *halt; /* where this rank is to stand still, for tests; NULL: nowhere */
    pthread_t thread;
    bool thread_runs;
    /* shared with the thread */
    pthread_mutex_t mutex;
    pthread_cond_t wake;
    bool leave;
    struct sign own;
    double back; /* when this rank came back from its last batch; 0: it is in no pass */
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

/* Does not return. MPI may hang with the ranks that are lost: then the process goes without it, and mpirun ends the
 * others. */
static void end_job(const struct kiln_watchdog *w)
{
    (void)fflush(stderr);
    (void)signal(SIGALRM, SIG_DFL);
    (void)alarm(ABORT_SECONDS);
    (void)MPI_Abort(w->communicator, KILN_RANK_LOST);
    _exit(KILN_RANK_LOST);
}

/* Whom this rank tells: all tell rank 0, which tells the last. */
static int listener(const struct kiln_watchdog *w) { return w->rank == 0 ? w->ranks - 1 : 0; }
/* Whom it hears: [*first, *end). */
static void heard(const struct kiln_watchdog *w, int *first, int *end)
{
    *first = w->rank == 0 ? 1 : 0;
    *end = w->rank == 0 ? w->ranks : w->rank == w->ranks - 1 ? 1 : 0;
}

static void tell(struct kiln_watchdog *w, const struct sign *sign)
{
    int sent = 1;
    if (w->sending != MPI_REQUEST_NULL)
        (void)MPI_Test(&w->sending, &sent, MPI_STATUS_IGNORE);
    if (sent == 0)
        return; /* the one before has not left */
    w->sent = *sign;
    (void)MPI_Isend(&w->sent, sizeof w->sent, MPI_BYTE, listener(w), TAG_SIGN, w->communicator, &w->sending);
}

static void receive(struct kiln_watchdog *w, int rank)
{
    (void)MPI_Recv(&w->witnesses[rank].sign, sizeof(struct sign), MPI_BYTE, rank, TAG_SIGN, w->communicator,
                   MPI_STATUS_IGNORE);
    w->witnesses[rank].seen = now();
}

static void listen(struct kiln_watchdog *w)
{
    int first, end;
    heard(w, &first, &end);
    for (int rank = first; rank < end; rank++)
        for (int there = 1; there != 0;) {
            (void)MPI_Iprobe(rank, TAG_SIGN, w->communicator, &there, MPI_STATUS_IGNORE);
            if (there != 0)
                receive(w, rank);
        }
    if (now() - w->last_look > 0.25 * w->limit + w->period) /* it was this rank that was away: let them speak first */
        for (int rank = first; rank < end; rank++)
            w->witnesses[rank].seen = fmax(w->witnesses[rank].seen, now() - 0.5 * w->limit);
    w->last_look = now();
}

/* ---- ranks that wait for each other ---- */

static bool is_alike(const struct sign *a, const struct sign *b)
{
    return strcmp(a->call, b->call) == 0 && strcmp(a->phase, b->phase) == 0;
}

static int count_alike(const struct kiln_watchdog *w, int rank)
{
    int count = 0;
    for (int r = 0; r < w->ranks; r++)
        count += is_alike(&w->witnesses[r].sign, &w->witnesses[rank].sign);
    return count;
}

/* The first of `most` ranks or fewer that stand where no rank before it does; -1: none. */
static int next_place(const struct kiln_watchdog *w, int after, int fewest, int most)
{
    for (int r = after; r < w->ranks; r++) {
        int same = 0;
        while (!is_alike(&w->witnesses[same].sign, &w->witnesses[r].sign))
            same++;
        const int count = same == r ? count_alike(w, r) : 0;
        if (count >= fewest && count <= most)
            return r;
    }
    return -1;
}

static void say_place_of(const struct kiln_watchdog *w, int rank, const char *before)
{
    const struct sign *sign = &w->witnesses[rank].sign;
    const int others = count_alike(w, rank) - 1;
    (void)fprintf(stderr, "%srank %d on %s", before, rank, w->hosts[rank]);
    if (others > 0)
        (void)fprintf(stderr, " and %d other%s", others, others == 1 ? "" : "s");
    (void)fprintf(stderr, " in %s ('%s')", sign->call, sign->phase);
}

/* Few ranks in a place are named before many: it is they who went astray. */
static void say_who_waits_where(const struct kiln_watchdog *w, double seconds)
{
    enum { PLACES = 6 };
    int said = 0;
    (void)fprintf(stderr, "kiln: error: all ranks wait for each other, and none has come on for %.0f s:", seconds);
    for (int size = 1; size <= w->ranks && said < PLACES; size++)
        for (int r = next_place(w, 0, size, size); r >= 0 && said < PLACES; r = next_place(w, r + 1, size, size))
            say_place_of(w, r, said++ == 0 ? " " : "; ");
    (void)fprintf(stderr, ". The job ends; run the same command again, and should this come again, report it\n");
}

/* Rank 0. A rank whose last sign is old may have come on since: its silence is judged, and not this. */
static void judge_all(struct kiln_watchdog *w)
{
    double least = INFINITY, grace = 0.0;
    for (int r = 0; r < w->ranks; r++) {
        const struct sign *sign = &w->witnesses[r].sign;
        if (sign->last != 0 || !(sign->waits > 0.0) || now() - w->witnesses[r].seen > 3.0 * w->period + 1.0)
            return;
        least = fmin(least, sign->waits);
        grace = fmax(grace, sign->grace);
    }
    if (least <= fmax(PATIENCE_LEAST, PATIENCE_SHARE * w->limit) + grace)
        return;
    say_who_waits_where(w, least);
    end_job(w);
}

/* ---- single ranks ---- */

static void judge(const struct kiln_watchdog *w, int rank)
{
    const struct sign *sign = &w->witnesses[rank].sign;
    const double silent = now() - w->witnesses[rank].seen;
    if (sign->last != 0)
        return;
    if (silent > w->limit)
        (void)fprintf(stderr,
                      "kiln: error: rank %d on %s has given no sign of life for %.1f s, and the others wait for it; "
                      "its last one was in "
                      "'%s'",
                      rank, w->hosts[rank], silent, sign->phase);
    else if (sign->away > fmax(w->limit, 4.0 * sign->batch))
        (void)fprintf(stderr,
                      "kiln: error: rank %d on %s has not come back from its work for %.1f s, and the others wait for "
                      "it; it is in '%s'",
                      rank, w->hosts[rank], sign->away, sign->phase);
    else if (sign->idle > w->limit)
        (void)fprintf(stderr,
                      "kiln: error: rank %d on %s has neither computed nor read nor written nor waited for other ranks "
                      "for %.1f s; it is in '%s'",
                      rank, w->hosts[rank], sign->idle, sign->phase);
    else if (sign->disk > DISK_LIMITS * w->limit)
        (void)fprintf(stderr, "kiln: error: rank %d on %s has waited for a disk for %.1f s; it is in '%s'", rank,
                      w->hosts[rank], sign->disk, sign->phase);
    else
        return;
    if (sign->share >= 0.0)
        (void)fprintf(stderr, " at %.0f %%", 100.0 * sign->share);
    (void)fprintf(stderr, ". The job ends; run the same command again\n");
    end_job(w);
}

static void watch_others(struct kiln_watchdog *w)
{
    int first, end;
    heard(w, &first, &end);
    if (end == first)
        return;
    listen(w);
    for (int rank = first; rank < end; rank++)
        judge(w, rank);
    if (w->rank == 0)
        judge_all(w);
}

/* It cannot know who is missing, but the job does not hang. */
static void give_up(const struct kiln_watchdog *w, const char *what)
{
    (void)fprintf(stderr,
                  "kiln: error: rank %d on %s has waited in '%s' for other ranks beyond the watchdog's limit of %g s: "
                  "one of them, or "
                  "the way to it, is lost; run the same command again\n",
                  w->rank, w->hosts[w->rank], what, w->limit);
    end_job(w);
}

static void say_place(struct sign *sign, const char *phase)
{
    (void)snprintf(sign->phase, sizeof sign->phase, "%s", phase);
    sign->share = -1.0;
}

/* What the process does, or waits for. */
static void look_at_oneself(struct kiln_watchdog *w, struct sign *sign, double time)
{
    struct kiln_waiting waiting;
    kiln_waiting_look(&waiting);
    kiln_activity_ask(&w->activity, time);
    if (waiting.call == NULL || waiting.steps != w->steps)
        w->still = time;
    w->steps = waiting.steps;
    sign->disk = kiln_activity_disk(&w->activity);
    if (waiting.call != NULL && !(sign->disk > 0.0)) {
        (void)snprintf(sign->call, sizeof sign->call, "%s", waiting.call);
        sign->waits = time - w->still;
        sign->grace += (double)waiting.bytes / NETWORK_BYTES;
    }
    /* within a pass it is `away` that counts: a device may be at work */
    if (waiting.call == NULL && !(sign->away > 0.0))
        sign->idle = kiln_activity_idle(&w->activity);
}

static void *run(void *data)
{
    struct kiln_watchdog *w = data;
    (void)pthread_mutex_lock(&w->mutex);
    while (!w->leave) {
        const double time = now();
        struct sign sign = w->own;
        sign.away = w->back > 0.0 ? time - w->back : 0.0;
        if (w->blocking != NULL) {
            say_place(&sign, w->blocking);
            sign.grace = w->blocking_grace;
        }
        const char *overdue = w->blocking != NULL && time > w->blocking_until ? w->blocking : NULL;
        (void)pthread_mutex_unlock(&w->mutex);
        if (overdue != NULL)
            give_up(w, overdue);
        look_at_oneself(w, &sign, time);
        tell(w, &sign);
        w->witnesses[w->rank] = (struct witness){.seen = time, .sign = sign};
        watch_others(w);
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

/* Signals are for the main thread. */
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

static int learn_hosts(struct kiln_watchdog *w, struct kiln_error *error)
{
    char own[HOST] = "";
    (void)gethostname(own, sizeof own - 1);
    int status = kiln_allocate(&w->hosts, (size_t)w->ranks, HOST, "the ranks' hosts", error);
    if (status == KILN_OK)
        status =
            kiln_allocate(&w->witnesses, (size_t)w->ranks, sizeof *w->witnesses, "the ranks' signs of life", error);
    status = kiln_agree(w->communicator, status, error);
    if (status == KILN_OK)
        (void)MPI_Allgather(own, HOST, MPI_BYTE, w->hosts, HOST, MPI_BYTE, w->communicator);
    return status;
}

static void halt_at(const struct kiln_watchdog *w, const char *place)
{
    if (w->halt != NULL && strcmp(w->halt, place) == 0)
        (void)raise(SIGSTOP);
}

/* KILN_HALT_RANK=RANK:PLACE */
static const char *own_halt(int rank)
{
    const char *text = getenv("KILN_HALT_RANK");
    char *rest = NULL;
    return text != NULL && strtol(text, &rest, 10) == rank && *rest == ':' ? rest + 1 : NULL;
}

static void begin_watch(struct kiln_watchdog *w)
{
    w->halt = own_halt(w->rank);
    w->own = (struct sign){.phase = "start", .share = -1.0};
    w->last_look = now();
    for (int rank = 0; rank < w->ranks; rank++)
        w->witnesses[rank] = (struct witness){.seen = w->last_look, .sign = w->own};
}

static void free_all(struct kiln_watchdog **watchdog)
{
    struct kiln_watchdog *w = *watchdog;
    (void)MPI_Comm_free(&w->communicator);
    (void)pthread_cond_destroy(&w->wake);
    (void)pthread_mutex_destroy(&w->mutex);
    kiln_free(&w->hosts);
    kiln_free(&w->witnesses);
    kiln_free(watchdog);
}

/* All ranks have the same library and the same limit. */
static bool is_possible(MPI_Comm communicator, double limit)
{
    int rank, ranks, level;
    (void)MPI_Comm_rank(communicator, &rank);
    (void)MPI_Comm_size(communicator, &ranks);
    (void)MPI_Query_thread(&level);
    if (limit <= 0.0 || ranks == 1)
        return false;
    if (level < MPI_THREAD_MULTIPLE && rank == 0)
        (void)fprintf(stderr, "kiln: warning: this MPI library does not let several threads call it "
                              "(MPI_THREAD_MULTIPLE): there is no watchdog\n");
    return level >= MPI_THREAD_MULTIPLE;
}

int kiln_watchdog_create(struct kiln_watchdog **watchdog, MPI_Comm communicator, double limit, struct kiln_error *error)
{
    struct kiln_watchdog *w = NULL;
    *watchdog = NULL;
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
    w->period = fmin(1.0, limit / 8.0);
    w->sending = MPI_REQUEST_NULL;
    (void)MPI_Comm_dup(communicator, &w->communicator);
    (void)MPI_Comm_rank(w->communicator, &w->rank);
    (void)MPI_Comm_size(w->communicator, &w->ranks);
    (void)pthread_mutex_init(&w->mutex, NULL);
    (void)pthread_cond_init(&w->wake, NULL);
    status = learn_hosts(w, error);
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

/* ---- before and after: without MPI, by the alarm clock ---- */

static char start_text[300]; /* for the handler, which gets nothing else */

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
                   "started: one of them "
                   "is lost, or does something else; give all ranks the same command, and run it again\n",
                   rank, host, ceil(seconds));
    (void)signal(SIGALRM, end_start);
    (void)alarm((unsigned)fmin(ceil(seconds), 1e6));
}

static void end_now(int number)
{
    static const char text[] = "kiln: error: the job does not come to its end within the watchdog's limit: a rank, or "
                               "the way to it, is lost; what "
                               "the bake's manifest names is complete\n";
    (void)number;
    (void)!write(STDERR_FILENO, text, sizeof text - 1);
    _exit(KILN_RANK_LOST);
}

/* Each rank's last sign is waited for, so that none is on its way when the communicator goes. */
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
    w->sent = (struct sign){.last = 1};
    (void)MPI_Isend(&w->sent, sizeof w->sent, MPI_BYTE, listener(w), TAG_SIGN, w->communicator, &w->sending);
    heard(w, &first, &end);
    for (int rank = first; rank < end; rank++)
        while (w->witnesses[rank].sign.last == 0)
            receive(w, rank);
    (void)MPI_Wait(&w->sending, MPI_STATUS_IGNORE);
    (void)signal(SIGALRM, end_now);
    (void)alarm((unsigned)fmin(ceil(w->limit), 1e6));
    halt_at(w, "MPI's end");
    *watchdog = NULL;
    free_all(&w);
}

/* ---- what the main thread says ---- */

void kiln_watchdog_phase(struct kiln_watchdog *w, const char *phase)
{
    if (w == NULL)
        return;
    (void)pthread_mutex_lock(&w->mutex);
    say_place(&w->own, phase);
    w->back = 0.0;
    (void)pthread_mutex_unlock(&w->mutex);
    halt_at(w, phase);
}

void kiln_watchdog_batch(struct kiln_watchdog *w, double share, double seconds)
{
    if (w == NULL)
        return;
    (void)pthread_mutex_lock(&w->mutex);
    w->own.share = share;
    w->own.batch = seconds;
    w->back = now();
    (void)pthread_mutex_unlock(&w->mutex);
}

void kiln_watchdog_rest(struct kiln_watchdog *w)
{
    if (w == NULL)
        return;
    (void)pthread_mutex_lock(&w->mutex);
    w->back = 0.0;
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
