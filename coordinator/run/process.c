#include "coordinator/run/process.h"

#include <errno.h>
#include <fcntl.h>
#include <malloc.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <unistd.h>

#include "coordinator/files/left_behind.h"
#include "worker/base/status.h"

static volatile sig_atomic_t noted; /* global, since a signal handler can write to nothing else */
/* Global for the same reason. interrupted: SIGINT has come before; ends: the process is ending; speaks_...: whom it
 * tells. */
static volatile sig_atomic_t interrupted, ends, speaks_to_user, speaks_json;

/* Atomic, since the handler runs in the main thread, and all threads read. */
static void note_signal(int number)
{
    const int before = errno;
    __atomic_store_n(&noted, number, __ATOMIC_RELAXED);
    if (number == SIGINT && interrupted != 0) { /* second SIGINT: it ends the process on return */
        kiln_left_remove();
        (void)signal(SIGINT, SIG_DFL);
        (void)raise(SIGINT);
    }
    interrupted = interrupted != 0 || number == SIGINT;
    errno = before;
}

/* Both of these are called by the handler: they may only call what is safe there. */
static void say(int descriptor, const char *begin, const char *name, const char *end)
{
    const char *const parts[] = {begin, name, end};
    for (int i = 0; i < 3; i++)
        (void)!write(descriptor, parts[i], strlen(parts[i]));
}

static void end_process(int number)
{
    if (__atomic_exchange_n(&ends, 1, __ATOMIC_SEQ_CST) != 0)
        return; /* another thread is at it */
    kiln_left_remove();
    const char *name = kiln_process_signal_name(number);
    if (speaks_to_user != 0)
        say(STDERR_FILENO, "kiln: stopped by ", name, "; the same command starts again\n");
    if (speaks_to_user != 0 && speaks_json != 0)
        say(STDOUT_FILENO, "{\"status\":\"stopped\",\"code\":75,\"message\":\"stopped by ", name,
            "; the same command starts again\"}\n");
    _exit(KILN_STOPPED);
}

/* Opens /dev/null in the wrong direction, so that reading from a closed descriptor 0, or writing to 1 or 2, still
 * fails. open() returns the lowest free number, which is `descriptor`. */
static void fill_descriptors(void)
{
    for (int descriptor = STDIN_FILENO; descriptor <= STDERR_FILENO; descriptor++)
        if (fcntl(descriptor, F_GETFD) < 0 && errno == EBADF)
            (void)open("/dev/null", descriptor == STDIN_FILENO ? O_WRONLY : O_RDONLY);
}

/* Fixes the size from which freed blocks return to the system. By default the C library raises it to the largest freed
 * block, up to 32 MiB. The memory that a process then keeps depends on the order in which threads free blocks. A
 * smaller size costs page faults: with 4 MiB the Cornell box of 200,000 points takes 7 % more CPU time. */
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

/* Raises the limit of the main thread's stack if it is too low: that stack grows up to the current limit. Other threads
 * have the C library's default, which is the limit when the process began. */
int kiln_process_need_stack(struct kiln_error *error)
{
    enum { NEEDED = 4 << 20 };
    struct rlimit limit;
    pthread_attr_t attributes;
    if (getrlimit(RLIMIT_STACK, &limit) != 0 || limit.rlim_cur >= NEEDED)
        return KILN_OK;
    if (limit.rlim_max < NEEDED)
        return kiln_fail(error, KILN_SYSTEM,
                         "the stack may have %llu KiB, and kiln needs %d: raise the limit first (ulimit -s %d)",
                         (unsigned long long)limit.rlim_max >> 10, NEEDED >> 10, NEEDED >> 10);
    limit.rlim_cur = NEEDED;
    if (setrlimit(RLIMIT_STACK, &limit) != 0)
        return kiln_fail_errno(error, KILN_SYSTEM, "the limit of the stack cannot be raised to %d KiB", NEEDED >> 10);
    errno = pthread_attr_init(&attributes);
    if (errno != 0)
        return kiln_fail_errno(error, KILN_SYSTEM, "the stack of threads cannot be set");
    errno = pthread_attr_setstacksize(&attributes, NEEDED);
    if (errno == 0)
        errno = pthread_setattr_default_np(&attributes);
    const int status = errno == 0 ? KILN_OK : kiln_fail_errno(error, KILN_SYSTEM, "the stack of threads cannot be set");
    (void)pthread_attr_destroy(&attributes);
    return status;
}

static const char PARENT[] = "KILN_ENDS_WITH";

void kiln_process_take_along(void)
{
    char own[24];
    (void)snprintf(own, sizeof own, "%ld", (long)getpid());
    (void)setenv(PARENT, own, 1);
}

/* Ends this process when its parent ends. Ranks and children of this process have another parent, which ends them. */
static void follow_parent(void)
{
    const char *text = getenv(PARENT);
    const long parent = text != NULL ? strtol(text, NULL, 10) : 0;
    if (text == NULL || getenv("OMPI_COMM_WORLD_RANK") != NULL)
        return;
    (void)prctl(PR_SET_PDEATHSIG, SIGKILL);
    if ((long)getppid() != parent)
        _exit(KILN_STOPPED); /* it has died already */
    (void)unsetenv(PARENT);
}

void kiln_process_begin(void)
{
    follow_parent();
    settle_memory();
    fill_descriptors();
    (void)signal(SIGXFSZ, SIG_IGN);
}

static void take(int number, void (*handler)(int))
{
    const struct sigaction action = {.sa_handler = handler, .sa_flags = SA_RESTART};
    (void)sigaction(number, &action, NULL);
}

static void take_all(void (*handler)(int))
{
    struct sigaction before;
    take(SIGUSR1, handler);
    take(SIGTERM, handler);
    take(SIGINT, handler);
    if (sigaction(SIGHUP, NULL, &before) == 0 && before.sa_handler != SIG_IGN)
        take(SIGHUP, handler);
}

void kiln_process_catch(void)
{
    interrupted = 0;
    take_all(note_signal); /* a batch system may send SIGTERM and SIGUSR1 more than once, with the same meaning */
    (void)signal(SIGPIPE, SIG_IGN);
}

void kiln_process_end_cleanly(bool speaks, bool json)
{
    speaks_to_user = speaks;
    speaks_json = json;
    take_all(end_process);
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
    take_all(SIG_DFL);
    take(SIGUSR1, SIG_IGN);
}
