#include "worker/base/mapped.h"

#include <pthread.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "worker/base/status.h"

enum { MAPPINGS = 32, SENTENCE = 640 };

/* `size` is set last and cleared first: where it is not 0, the other fields are valid. */
static struct mapping {
    _Atomic uintptr_t base;
    _Atomic size_t size;
    char sentence[SENTENCE];
} mappings[MAPPINGS];

static pthread_mutex_t changing = PTHREAD_MUTEX_INITIALIZER;
static struct sigaction before;
static _Bool installed;

/* Async-signal-safe: loads, write, _exit, sigaction. */
static void on_bus_error(int number, siginfo_t *info, void *context)
{
    const uintptr_t at = (uintptr_t)info->si_addr;
    (void)context;
    for (size_t i = 0; i < MAPPINGS; i++) {
        const size_t size = atomic_load(&mappings[i].size);
        const uintptr_t base = atomic_load(&mappings[i].base);
        if (size > 0 && at >= base && at - base < size) {
            (void)!write(STDERR_FILENO, mappings[i].sentence, strlen(mappings[i].sentence));
            _exit(KILN_IO);
        }
    }
    /* the access is repeated on return and reaches the handler that was there before */
    (void)sigaction(number, &before, NULL);
}

static void install(void)
{
    struct sigaction action = {.sa_sigaction = on_bus_error, .sa_flags = SA_SIGINFO};
    (void)sigemptyset(&action.sa_mask);
    if (!installed)
        installed = sigaction(SIGBUS, &action, &before) == 0;
}

void kiln_mapped_watch(const void *base, size_t size, const char *name)
{
    (void)pthread_mutex_lock(&changing);
    install();
    for (size_t i = 0; i < MAPPINGS && size > 0; i++) {
        if (atomic_load(&mappings[i].size) != 0)
            continue;
        (void)snprintf(
            mappings[i].sentence, SENTENCE,
            "kiln: error: '%.400s' was made shorter while kiln was using it, or its disk cannot be read: nothing may "
            "change it while kiln runs; run the same command again\n",
            name);
        for (char *c = mappings[i].sentence; c[1] != '\0'; c++) /* all but the last character, which ends the line */
            if ((unsigned char)*c < ' ' || *c == 0x7f)
                *c = '?';
        atomic_store(&mappings[i].base, (uintptr_t)base);
        atomic_store(&mappings[i].size, size);
        break;
    }
    (void)pthread_mutex_unlock(&changing);
}

void kiln_mapped_forget(const void *base)
{
    (void)pthread_mutex_lock(&changing);
    for (size_t i = 0; i < MAPPINGS; i++)
        if (atomic_load(&mappings[i].size) != 0 && atomic_load(&mappings[i].base) == (uintptr_t)base)
            atomic_store(&mappings[i].size, 0);
    (void)pthread_mutex_unlock(&changing);
}
