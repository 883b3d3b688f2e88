/* The threads of a bake at work side by side, for ThreadSanitizer (preset tsan); in other builds a test that run
 * control gives all ranks the same events. Run by mpirun on three ranks, with a folder to work in as argument.
 *
 * On each rank: the main thread, as in a pass; the watchdog's thread; two threads that ask whether to stop, as import
 * and surface do. On rank 0 also the threads of the progress display and of the status file. */
#include <mpi.h>
#include <pthread.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "coordinator/mpi/waiting.h"
#include "coordinator/mpi/watchdog.h"
#include "coordinator/run/control.h"
#include "coordinator/run/process.h"
#include "coordinator/run/progress.h"

enum { RANKS = 3, PASSES = 3, ASKERS = 2, BATCHES = 12, CHECKED_EVENTS = 64 };

struct asker {
    pthread_t thread;
    const struct kiln_stop *stop;
    atomic_bool *leave;
    bool asked;
};

struct events {
    int kinds[CHECKED_EVENTS], count;
};

static void rest(double milliseconds) { (void)nanosleep(&(struct timespec){0, (long)(1e6 * milliseconds)}, NULL); }

static void fail(const char *what)
{
    (void)fprintf(stderr, "%s\n", what);
    MPI_Abort(MPI_COMM_WORLD, 1);
}

static void *ask(void *data)
{
    struct asker *asker = data;
    while (!atomic_load(asker->leave)) {
        asker->asked = kiln_stop_asked(asker->stop);
        rest(1.0);
    }
    return NULL;
}

/* One pass, in which each rank has another amount of work. Returns the event that ended it. */
static enum kiln_event run_pass(struct kiln_control *control, struct kiln_progress *progress, int rank,
                                struct events *events)
{
    const int batches = BATCHES * (rank + 1);
    enum kiln_event event = KILN_EVENT_NONE;
    kiln_progress_phase(progress, "pass", (uint64_t)batches);
    kiln_control_begin(control, "pass");
    for (int done = 0; event == KILN_EVENT_NONE || event == KILN_EVENT_SAVE;) {
        if (done < batches) {
            rest(10.0);
            kiln_progress_advance(progress, (uint64_t)++done);
            event = kiln_control_poll(control, done == batches, (double)done / batches, 0.01, 0);
        } else {
            event = kiln_control_wait(control, true, 1.0, 0, NULL, NULL);
        }
        if (event != KILN_EVENT_NONE && events->count < CHECKED_EVENTS)
            events->kinds[events->count++] = (int)event;
        if (event == KILN_EVENT_SAVE) {
            kiln_control_saved(control, 1, 0.001, 0.0);
            kiln_control_begin(control, "pass");
        }
    }
    return event;
}

/* All passes, then one that a signal on rank 1 ends. */
static void run_passes(struct kiln_control *control, struct kiln_progress *progress, int rank, struct events *events)
{
    for (int pass = 0; pass < PASSES; pass++) {
        if (run_pass(control, progress, rank, events) != KILN_EVENT_DONE)
            fail("a pass ended before its ranks were done");
        (void)kiln_control_between(control, 1000);
        kiln_control_meet(control);
    }
    if (rank == 1)
        (void)raise(SIGUSR1);
    if (run_pass(control, progress, rank, events) != KILN_EVENT_STOP)
        fail("a signal did not stop the pass");
    kiln_progress_finish(progress);
}

static void check_events(const struct events *own)
{
    struct events first = *own;
    MPI_Bcast(&first, sizeof first, MPI_BYTE, 0, MPI_COMM_WORLD);
    if (first.count != own->count)
        fail("not all ranks got the same number of events");
    for (int i = 0; i < own->count; i++)
        if (first.kinds[i] != own->kinds[i])
            fail("not all ranks got the same events");
}

static void run(const char *folder, int rank)
{
    struct kiln_error error = {""};
    struct kiln_watchdog *watchdog = NULL;
    struct kiln_control *control = NULL;
    struct events events = {{0}, 0};
    struct asker askers[ASKERS];
    atomic_bool leave = false;
    if (kiln_watchdog_create(&watchdog, MPI_COMM_WORLD, 8.0, NULL, &error) != 0)
        fail(error.message);
    const struct kiln_control_params params = {.communicator = MPI_COMM_WORLD,
                                               .directory = folder,
                                               .begin = MPI_Wtime(),
                                               .checkpoint_every = 0.2,
                                               .watchdog = watchdog,
                                               .limit = 8.0,
                                               .signal = kiln_process_signal()};
    if (kiln_control_create(&control, &params, &error) != 0)
        fail(error.message);
    struct kiln_progress *progress = kiln_progress_create(false, rank);
    kiln_control_follow(control, progress);
    for (int i = 0; i < ASKERS; i++) {
        askers[i] = (struct asker){.stop = kiln_control_stop(control), .leave = &leave};
        if (pthread_create(&askers[i].thread, NULL, ask, &askers[i]) != 0)
            fail("no thread");
    }
    run_passes(control, progress, rank, &events);
    while (!kiln_stop_asked(kiln_control_stop(control))) /* rank 1 has told the others by a file */
        rest(10.0);
    kiln_control_meet(control); /* rank 0 removes the file when all have seen it */
    atomic_store(&leave, true);
    for (int i = 0; i < ASKERS; i++)
        (void)pthread_join(askers[i].thread, NULL);
    check_events(&events);
    kiln_control_conclude(control, 0, "", true);
    kiln_progress_destroy(&progress);
    kiln_control_destroy(&control);
    kiln_watchdog_destroy(&watchdog);
}

int main(int argc, char **argv)
{
    int rank = 0, size = 0, provided = 0;
    kiln_process_catch();
    kiln_waiting_follow();
    MPI_Init_thread(&argc, &argv, MPI_THREAD_MULTIPLE, &provided);
    MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    MPI_Comm_size(MPI_COMM_WORLD, &size);
    if (size != RANKS || argc != 2 || provided < MPI_THREAD_MULTIPLE)
        fail("this test wants three ranks, a folder and an MPI library for threads");
    run(argv[1], rank);
    MPI_Finalize();
    return 0;
}
