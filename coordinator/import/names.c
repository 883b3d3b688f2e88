#include "coordinator/import/names.h"

#include <assert.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>
#include <xxhash.h>

#include "worker/base/memory.h"

enum { SUFFIX_LENGTH = 11 }; /* "_4294967295" */

static size_t slot_of(const struct kiln_names *names, const char *name)
{
    char lower[KILN_NAME_LENGTH + 1];
    const size_t length = strlen(name);
    assert(length <= KILN_NAME_LENGTH);
    for (size_t i = 0; i < length; i++)
        lower[i] = (char)(name[i] >= 'A' && name[i] <= 'Z' ? name[i] | 0x20 : name[i]);
    size_t slot = (size_t)XXH3_64bits(lower, length) & (names->slot_count - 1);
    while (names->slots[slot].name != NULL && strcasecmp(names->slots[slot].name, name) != 0)
        slot = (slot + 1) & (names->slot_count - 1);
    return slot;
}

static int make_room(struct kiln_names *names, struct kiln_error *error)
{
    if (2 * (names->used + 1) <= names->slot_count)
        return KILN_OK;
    struct kiln_names old = *names;
    names->slot_count = old.slot_count == 0 ? 64 : 2 * old.slot_count;
    names->slots = NULL;
    const int status = kiln_allocate(&names->slots, names->slot_count, sizeof *names->slots, "object names", error);
    if (status != KILN_OK) {
        *names = old;
        return status;
    }
    for (size_t i = 0; i < old.slot_count; i++)
        if (old.slots[i].name != NULL)
            names->slots[slot_of(names, old.slots[i].name)] = old.slots[i];
    kiln_free(&old.slots);
    return KILN_OK;
}

static int take(struct kiln_names *names, const char *name, struct kiln_error *error)
{
    const size_t slot = slot_of(names, name), length = strlen(name);
    const int status = kiln_allocate(&names->slots[slot].name, length + 1, 1, "an object's name", error);
    if (status != KILN_OK)
        return status;
    memcpy(names->slots[slot].name, name, length);
    names->slots[slot].next = 2;
    names->used++;
    return KILN_OK;
}

static void clean(const char *wish, char name[KILN_NAME_LENGTH + 1])
{
    size_t length = 0;
    for (; wish[length] != '\0' && length < KILN_NAME_LENGTH - SUFFIX_LENGTH; length++) {
        const char c = wish[length];
        const int plain = (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_' ||
                          c == '-' || c == '.';
        name[length] = plain && !(length == 0 && (c == '.' || c == '-')) ? c : '_';
    }
    name[length] = '\0';
    if (length == 0)
        memcpy(name, "object", sizeof "object");
}

int kiln_names_unique(struct kiln_names *names, const char *wish, char name[KILN_NAME_LENGTH + 1],
                      struct kiln_error *error)
{
    char base[KILN_NAME_LENGTH + 1];
    clean(wish, base);
    memcpy(name, base, sizeof base);
    int status = make_room(names, error);
    if (status != KILN_OK)
        return status;
    /* numbers continue after the last one given to this base name, so that a million equal names take linear time */
    struct kiln_names_entry *entry = &names->slots[slot_of(names, base)];
    while (names->slots[slot_of(names, name)].name != NULL)
        (void)snprintf(name, KILN_NAME_LENGTH + 1, "%.*s_%u", KILN_NAME_LENGTH - SUFFIX_LENGTH, base, entry->next++);
    return take(names, name, error);
}

void kiln_names_destroy(struct kiln_names *names)
{
    for (size_t i = 0; i < names->slot_count; i++)
        kiln_free(&names->slots[i].name);
    kiln_free(&names->slots);
    *names = (struct kiln_names){0};
}
