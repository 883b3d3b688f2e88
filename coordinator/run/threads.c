#include "coordinator/run/threads.h"

#include <pthread.h>
#include <string.h>

#include "worker/base/memory.h"

/* Each thread waits on the mutex until all have been started. */
static void *wait_for_start(void *data)
{
    pthread_mutex_t *started = data;
    (void)pthread_mutex_lock(started);
    (void)pthread_mutex_unlock(started);
    return NULL;
}

int kiln_threads_check(uint32_t count, struct kiln_error *error)
{
    pthread_mutex_t all_started = PTHREAD_MUTEX_INITIALIZER;
    pthread_t *threads = NULL;
    uint32_t started = 0;
    int status = kiln_allocate(&threads, count, sizeof *threads, "the threads", error), problem = 0;
    if (status != KILN_OK)
        return status;
    (void)pthread_mutex_lock(&all_started);
    while (started < count && problem == 0) {
        problem = pthread_create(&threads[started], NULL, wait_for_start, &all_started);
        started += problem == 0;
    }
    (void)pthread_mutex_unlock(&all_started);
    for (uint32_t i = 0; i < started; i++)
        (void)pthread_join(threads[i], NULL);
    kiln_free(&threads);
    if (problem != 0)
        status = kiln_fail(
            error, KILN_SYSTEM,
            "%u threads are needed, and only %u can be started (%s): raise ulimit -u or -v, or use fewer --threads",
            count, started, strerror(problem));
    return status;
}
