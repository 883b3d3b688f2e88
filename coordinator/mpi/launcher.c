#include "coordinator/mpi/launcher.h"

#include <pthread.h>
#include <signal.h>
#include <stdint.h>
#include <unistd.h>

#include "worker/base/status.h"

enum { PERIOD = 1, GRACE = 3 /* s; in that time the MPI library may end the process by itself */ };

static void *watch(void *parent)
{
    while ((intptr_t)getppid() == (intptr_t)parent)
        (void)sleep(PERIOD);
    (void)sleep(GRACE);
    _exit(KILN_RANK_LOST);
}

void kiln_launcher_watch(void)
{
    pthread_t thread;
    sigset_t all, before;
    (void)sigfillset(&all);
    (void)pthread_sigmask(SIG_SETMASK, &all, &before); /* signals are the main thread's */
    if (pthread_create(&thread, NULL, watch, (void *)(intptr_t)getppid()) == 0)
        (void)pthread_detach(thread);
    (void)pthread_sigmask(SIG_SETMASK, &before, NULL);
}
