/* Ranks that wait for others give their core away, but come back at once and ask again: a third of the processor time
 * of a small bake by several ranks, and what they wait for runs later. Loaded before other libraries (LD_PRELOAD), this
 * sched_yield sleeps for a moment each fourth time. */
#define _GNU_SOURCE
#include <sched.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

int sched_yield(void)
{
    static _Thread_local unsigned calls;
    if (++calls % 4 != 0)
        return (int)syscall(SYS_sched_yield);
    const struct timespec moment = {.tv_nsec = 100000};
    nanosleep(&moment, NULL);
    return 0;
}
