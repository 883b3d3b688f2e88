#include "coordinator/run/process.h"

#include <errno.h>
#include <fcntl.h>
#include <malloc.h>
#include <unistd.h>

static volatile sig_atomic_t noted; /* global, since a signal handler can write to nothing else */

/* Atomic, since the handler runs in the main thread, and all threads read. */
static void note_signal(int number) { __atomic_store_n(&noted, number, __ATOMIC_RELAXED); }

/* Opens /dev/null in the wrong direction, so that reading from a closed descriptor 0, or writing to 1 or 2, still
 * fails. open() returns the lowest free number, which is `descriptor`. */
static void fill_descriptors(void)
{
    for (int descriptor = STDIN_FILENO; descriptor <= STDERR_FILENO; descriptor++)
        if (fcntl(descriptor, F_GETFD) < 0 && errno == EBADF)
            (void)open("/dev/null", descriptor == STDIN_FILENO ? O_WRONLY : O_RDONLY);
}

/* Without this the C library raises the size from which blocks go back to the system to that of the largest block that
 * was freed, 32 MiB at most. What a process then keeps of blocks below depends on the order in which threads free. A
 * smaller size costs page faults: with 4 MiB the Cornell box of 200,000 points takes 7 % more of the processor. */
static void settle_memory(void)
{
#ifdef __GLIBC__
    enum { LARGE = 32 << 20, KEPT = 64 << 20 };
    (void)mallopt(M_MMAP_THRESHOLD, LARGE);
    (void)mallopt(M_TRIM_THRESHOLD, KEPT);
#endif
}

void kiln_process_give_back(void)
{
#ifdef __GLIBC__
    (void)malloc_trim(0);
#endif
}

void kiln_process_begin(void)
{
    settle_memory();
    fill_descriptors();
    (void)signal(SIGXFSZ, SIG_IGN);
}

static void take(int number, void (*handler)(int), int flags)
{
    const struct sigaction action = {.sa_handler = handler, .sa_flags = flags | SA_RESTART};
    (void)sigaction(number, &action, NULL);
}

void kiln_process_catch(void)
{
    struct sigaction before;
    take(SIGUSR1, note_signal, 0);
    /* a batch system may send SIGTERM and SIGUSR1 more than once, with the same meaning each time */
    take(SIGTERM, note_signal, 0);
    take(SIGINT, note_signal, (int)SA_RESETHAND);
    if (sigaction(SIGHUP, NULL, &before) == 0 && before.sa_handler != SIG_IGN)
        take(SIGHUP, note_signal, 0);
    (void)signal(SIGPIPE, SIG_IGN);
}

const volatile sig_atomic_t *kiln_process_signal(void) { return &noted; }

const char *kiln_process_signal_name(int number)
{
    switch (number) {
    case SIGUSR1:
        return "SIGUSR1";
    case SIGTERM:
        return "SIGTERM";
    case SIGINT:
        return "SIGINT";
    case SIGHUP:
        return "SIGHUP";
    default:
        return "a signal";
    }
}

void kiln_process_release(void)
{
    struct sigaction before;
    take(SIGINT, SIG_DFL, 0);
    take(SIGTERM, SIG_DFL, 0);
    take(SIGUSR1, SIG_IGN, 0);
    if (sigaction(SIGHUP, NULL, &before) == 0 && before.sa_handler != SIG_IGN)
        take(SIGHUP, SIG_DFL, 0);
}
