#include "coordinator/run/threads.h"

#include <pthread.h>
#include <string.h>

#include "worker/base/memory.h"

/* Each waits until all are there, or no more come. */
static void *wait_for_word(void *data)
{
    pthread_mutex_t *word = data;
    (void)pthread_mutex_lock(word);
    (void)pthread_mutex_unlock(word);
    return NULL;
}

int kiln_threads_check(uint32_t count, struct kiln_error *error)
{
    pthread_mutex_t word = PTHREAD_MUTEX_INITIALIZER;
    pthread_t *threads = NULL;
    uint32_t started = 0;
    int status = kiln_allocate(&threads, count, sizeof *threads, "the threads", error), problem = 0;
    if (status != KILN_OK)
        return status;
    (void)pthread_mutex_lock(&word);
    while (started < count && problem == 0) {
        problem = pthread_create(&threads[started], NULL, wait_for_word, &word);
        started += problem == 0;
    }
    (void)pthread_mutex_unlock(&word);
    for (uint32_t i = 0; i < started; i++)
        (void)pthread_join(threads[i], NULL);
    kiln_free(&threads);
    if (problem != 0)
        status =
            kiln_fail(error, KILN_SYSTEM,
                      "%u threads are needed and %u can be had (%s): raise ulimit -u or -v, or give fewer --threads",
                      count, started, strerror(problem));
    return status;
}
