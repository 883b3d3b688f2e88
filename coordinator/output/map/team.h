/* A team: threads that work on one thing in short steps, some thousand times, and wait for one another in between. They
 * look again and again, which takes less time than sleeping and waking up; after a while they let others have the core.
 *
 * Each thread has a part of some numbers. Sums over all are added up in the order of threads, one thread after the
 * other, each from the first of its part to the last: so a sum has the same bits for any number of threads. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_TEAM_H
#define KILN_COORDINATOR_OUTPUT_MAP_TEAM_H

#include <sched.h>
#include <stdatomic.h>
#include <stddef.h>

enum { KILN_TEAM_SUMS = 8 };

struct kiln_team {
    unsigned threads;
    _Alignas(64) atomic_uint arrived;
    _Alignas(64) atomic_uint meetings; /* that are over */
    _Alignas(64) atomic_uint turn;     /* sums that threads have added to, all in all */
    _Alignas(64) double sums[2][KILN_TEAM_SUMS];
};

/* A thread of the team, and its part [begin, end) of so many numbers. */
struct kiln_team_member {
    struct kiln_team *team;
    unsigned thread, sums; /* sums: that the team has begun */
};

static inline void kiln_team_part(const struct kiln_team_member *m, size_t count, size_t *begin, size_t *end)
{
    *begin = count * m->thread / m->team->threads;
    *end = count * (m->thread + (size_t)1) / m->team->threads;
}

static inline void kiln_team_wait(atomic_uint *number, unsigned until)
{
    enum { LOOKS = 100 };
    for (int looks = 0; (int)(atomic_load_explicit(number, memory_order_acquire) - until) < 0; looks++) {
#ifdef __x86_64__
        if (looks < LOOKS)
            __builtin_ia32_pause();
#endif
        if (looks >= LOOKS)
            (void)sched_yield();
    }
}

/* Waits until all threads are here. */
static inline void kiln_team_meet(const struct kiln_team_member *m)
{
    struct kiln_team *t = m->team;
    const unsigned meetings = atomic_load_explicit(&t->meetings, memory_order_relaxed);
    if (t->threads == 1)
        return;
    if (atomic_fetch_add_explicit(&t->arrived, 1, memory_order_acq_rel) + 1 < t->threads) {
        kiln_team_wait(&t->meetings, meetings + 1);
        return;
    }
    atomic_store_explicit(&t->arrived, 0, memory_order_relaxed);
    atomic_store_explicit(&t->meetings, meetings + 1, memory_order_release);
}

/* Waits for this thread's turn, and returns the sums so far, zeros at first, to which it adds its part. They are two
 * sets in turn: all threads must meet between one sum and the next but one. */
static inline double *kiln_team_begin_sum(const struct kiln_team_member *m)
{
    double *sums = m->team->sums[m->sums % 2];
    kiln_team_wait(&m->team->turn, m->sums * m->team->threads + m->thread);
    for (int i = 0; m->thread == 0 && i < KILN_TEAM_SUMS; i++)
        sums[i] = 0.0;
    return sums;
}

/* Hands the sums on, and waits until they are complete. */
static inline void kiln_team_end_sum(struct kiln_team_member *m)
{
    struct kiln_team *t = m->team;
    atomic_store_explicit(&t->turn, m->sums * t->threads + m->thread + 1, memory_order_release);
    m->sums++;
    kiln_team_wait(&t->turn, m->sums * t->threads);
}

#endif
