#include "coordinator/run/process.h"

#include <errno.h>
#include <fcntl.h>
#include <unistd.h>

static volatile sig_atomic_t noted; /* the one thing a signal handler can write to */

static void note_signal(int number) { noted = number; }

/* Opened for the other way, so that reading from a closed descriptor 0, or writing to 1 or 2, fails as it would
 * without. The lowest free number is the one that open takes. */
static void fill_descriptors(void)
{
    for (int descriptor = STDIN_FILENO; descriptor <= STDERR_FILENO; descriptor++)
        if (fcntl(descriptor, F_GETFD) < 0 && errno == EBADF)
            (void)open("/dev/null", descriptor == STDIN_FILENO ? O_WRONLY : O_RDONLY);
}

void kiln_process_begin(void)
{
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
    /* which, like SIGUSR1, may come more than once from a queue, and means the same each time */
    take(SIGTERM, note_signal, 0);
    take(SIGINT, note_signal, (int)SA_RESETHAND);
    if (sigaction(SIGHUP, NULL, &before) == 0 && before.sa_handler != SIG_IGN)
        take(SIGHUP, note_signal, 0);
    (void)signal(SIGPIPE, SIG_IGN);
}

const volatile sig_atomic_t *kiln_process_signal(void) { return &noted; }

void kiln_process_release(void)
{
    struct sigaction before;
    take(SIGINT, SIG_DFL, 0);
    take(SIGTERM, SIG_DFL, 0);
    take(SIGUSR1, SIG_IGN, 0);
    if (sigaction(SIGHUP, NULL, &before) == 0 && before.sa_handler != SIG_IGN)
        take(SIGHUP, SIG_DFL, 0);
}
