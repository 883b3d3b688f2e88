/* Helper threads, beside the main thread. */
#ifndef KILN_WORKER_BASE_THREAD_H
#define KILN_WORKER_BASE_THREAD_H

#include <pthread.h>
#include <signal.h>
#include <sched.h>
#include <stdbool.h>
#include <sys/resource.h>
#include <unistd.h>

/* Starts a thread with all signals blocked, so that the main thread receives them. Returns false if no thread can be
 * created; else the thread must be joined. */
static inline bool kiln_thread_start(pthread_t *thread, void *(*run)(void *context), void *context)
{
    sigset_t all, before;
    (void)sigfillset(&all);
    (void)pthread_sigmask(SIG_SETMASK, &all, &before);
    const bool started = pthread_create(thread, NULL, run, context) == 0;
    (void)pthread_sigmask(SIG_SETMASK, &before, NULL);
    return started;
}

/* Gives the calling thread the lowest priority, from now on. */
static inline void kiln_thread_give_way(void)
{
    enum { LOWEST_PRIORITY = 19 };
    const struct sched_param none = {0};
    (void)pthread_setschedparam(pthread_self(), SCHED_BATCH, &none);
    (void)setpriority(PRIO_PROCESS, (id_t)gettid(), LOWEST_PRIORITY); /* on Linux: of this thread */
}

#endif
