#include "coordinator/files/left_behind.h"

#include <stdatomic.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "worker/base/memory.h"

enum { FREE, FILLING, THERE, NAME_SIZE = 544 };

struct kiln_left {
    atomic_int state;
    int folder;
    char name[NAME_SIZE];
    struct kiln_left *next;
};

/* The last entry that was made. Entries are never freed, so that a handler can follow `next` at any moment. */
static _Atomic(struct kiln_left *) entries;

static struct kiln_left *take_free(void)
{
    for (struct kiln_left *entry = atomic_load(&entries); entry != NULL; entry = entry->next) {
        int expected = FREE;
        if (atomic_compare_exchange_strong(&entry->state, &expected, FILLING))
            return entry;
    }
    return NULL;
}

static struct kiln_left *make_one(void)
{
    struct kiln_left *entry = NULL;
    if (kiln_allocate(&entry, 1, sizeof *entry, "the name of a temporary file", NULL) != KILN_OK)
        return NULL;
    atomic_store(&entry->state, FILLING);
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
    if (*left != NULL)
        atomic_store(&(*left)->state, FREE);
    *left = NULL;
}

void kiln_left_remove(void)
{
    for (struct kiln_left *entry = atomic_load(&entries); entry != NULL; entry = entry->next)
        if (atomic_load(&entry->state) == THERE)
            (void)unlinkat(entry->folder, entry->name, 0);
}
