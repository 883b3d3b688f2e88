#include "coordinator/bake/watchdog.h"

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

#include "coordinator/cli/agree.h"
#include "worker/base/memory.h"

enum { TAG_SIGN = 7, HOST = 64, PHASE = 48, ABORT_SECONDS = 10 };

/* What a rank says of itself. */
struct sign {
    char phase[PHASE];
    double share;  /* of a pass */
    double batch;  /* s, its last one */
    double away;   /* s since it came back from that; 0: it is in no pass */
    int32_t last;  /* no other will come */
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
    double blocking_until;
};

static double now(void)
{
    struct timespec t;
    (void)clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* ---- the thread ---- */

/* Does not return. MPI may hang with the ranks that are lost: then the process goes without it, and mpirun ends the others. */
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
    (void)MPI_Recv(&w->witnesses[rank].sign, sizeof(struct sign), MPI_BYTE, rank, TAG_SIGN, w->communicator, MPI_STATUS_IGNORE);
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

static void judge(const struct kiln_watchdog *w, int rank)
{
    const struct sign *sign = &w->witnesses[rank].sign;
    const double silent = now() - w->witnesses[rank].seen;
    if (sign->last != 0)
        return;
    if (silent > w->limit)
        (void)fprintf(stderr, "kiln: error: rank %d on %s has given no sign of life for %.1f s, and the others wait for it; its last one was in "
                      "'%s'", rank, w->hosts[rank], silent, sign->phase);
    else if (sign->away > fmax(w->limit, 4.0 * sign->batch))
        (void)fprintf(stderr, "kiln: error: rank %d on %s has not come back from its work for %.1f s, and the others wait for it; it is in '%s'", rank,
                      w->hosts[rank], sign->away, sign->phase);
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
}

/* It cannot know who is missing, but the job does not hang. */
static void give_up(const struct kiln_watchdog *w, const char *what)
{
    (void)fprintf(stderr, "kiln: error: rank %d on %s has waited in '%s' for other ranks beyond the watchdog's limit of %g s: one of them, or "
                  "the way to it, is lost; run the same command again\n", w->rank, w->hosts[w->rank], what, w->limit);
    end_job(w);
}

static void say_place(struct sign *sign, const char *phase)
{
    (void)snprintf(sign->phase, sizeof sign->phase, "%s", phase);
    sign->share = -1.0;
}

static void *run(void *data)
{
    struct kiln_watchdog *w = data;
    (void)pthread_mutex_lock(&w->mutex);
    while (!w->leave) {
        const double time = now();
        struct sign sign = w->own;
        sign.away = w->back > 0.0 ? time - w->back : 0.0;
        if (w->blocking != NULL)
            say_place(&sign, w->blocking);
        const char *overdue = w->blocking != NULL && time > w->blocking_until ? w->blocking : NULL;
        (void)pthread_mutex_unlock(&w->mutex);
        if (overdue != NULL)
            give_up(w, overdue);
        tell(w, &sign);
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
    return w->thread_runs ? KILN_OK : kiln_fail(error, KILN_SYSTEM, "no thread can be started for the watchdog: raise the limit of processes");
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
        status = kiln_allocate(&w->witnesses, (size_t)w->ranks, sizeof *w->witnesses, "the ranks' signs of life", error);
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
        (void)fprintf(stderr, "kiln: warning: this MPI library does not let several threads call it (MPI_THREAD_MULTIPLE): there is no watchdog\n");
    return level >= MPI_THREAD_MULTIPLE;
}

int kiln_watchdog_create(struct kiln_watchdog **watchdog, MPI_Comm communicator, double limit, struct kiln_error *error)
{
    struct kiln_watchdog *w = NULL;
    *watchdog = NULL;
    if (!is_possible(communicator, limit))
        return KILN_OK;
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
        if (kiln_agree(communicator, status, error) == KILN_OK) {
            *watchdog = w;
            return KILN_OK;
        }
        status = status == KILN_OK ? KILN_SYSTEM : status;
    }
    stop_thread(w);
    free_all(&w);
    return status;
}

static void end_now(int number)
{
    static const char text[] = "kiln: error: the job does not come to its end within the watchdog's limit: a rank, or the way to it, is lost; what "
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
    (void)pthread_mutex_unlock(&w->mutex);
    if (what != NULL)
        halt_at(w, what);
}
