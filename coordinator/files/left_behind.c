#include "coordinator/files/left_behind.h"

#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "worker/base/memory.h"

enum { GONE, THERE, NAME_SIZE = 544 };

struct kiln_left {
    atomic_int state;
    int folder;
    char name[NAME_SIZE];
    struct kiln_left *next;
    struct kiln_left *next_free;
};

/* The last entry that was made. Entries are never freed, so that a handler can follow `next` at any moment. */
static _Atomic(struct kiln_left *) entries;
/* Entries whose files are gone, and their lock, which no handler takes. */
static struct kiln_left *free_entries;
static pthread_mutex_t reusing = PTHREAD_MUTEX_INITIALIZER;

static struct kiln_left *take_free(void)
{
    (void)pthread_mutex_lock(&reusing);
    struct kiln_left *entry = free_entries;
    if (entry != NULL)
        free_entries = entry->next_free;
    (void)pthread_mutex_unlock(&reusing);
    return entry;
}

static struct kiln_left *make_one(void)
{
    struct kiln_left *entry = NULL;
    if (kiln_allocate(&entry, 1, sizeof *entry, "the name of a temporary file", NULL) != KILN_OK)
        return NULL;
    entry->next = atomic_load(&entries);
    while (!atomic_compare_exchange_weak(&entries, &entry->next, entry))
        ;
    return entry;
}

struct kiln_left *kiln_left_note(int folder, const char *name)
{
    if (strlen(name) >= NAME_SIZE)
        return NULL;
    struct kiln_left *entry = take_free();
    if (entry == NULL)
        entry = make_one();
    if (entry == NULL)
        return NULL;
    entry->folder = folder;
    (void)snprintf(entry->name, sizeof entry->name, "%s", name);
    atomic_store(&entry->state, THERE);
    return entry;
}

void kiln_left_forget(struct kiln_left **left)
{
    struct kiln_left *entry = *left;
    *left = NULL;
    if (entry == NULL)
        return;
    atomic_store(&entry->state, GONE);
    (void)pthread_mutex_lock(&reusing);
    entry->next_free = free_entries;
    free_entries = entry;
    (void)pthread_mutex_unlock(&reusing);
}

void kiln_left_remove(void)
{
    for (struct kiln_left *entry = atomic_load(&entries); entry != NULL; entry = entry->next)
        if (atomic_load(&entry->state) == THERE)
            (void)unlinkat(entry->folder, entry->name, 0);
}
