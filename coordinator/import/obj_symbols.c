#include "coordinator/import/obj_symbols.h"

#include <string.h>
#include <xxhash.h>

#include "worker/base/memory.h"

static struct obj_symbol *slot_of(const struct obj_symbols *s, const char *name, size_t length, uint64_t hash)
{
    size_t slot = (size_t)hash & (s->slot_count - 1);
    while (s->slots[slot].taken && (s->slots[slot].hash != hash || s->slots[slot].length != length ||
                                    memcmp(s->text + s->slots[slot].name, name, length) != 0))
        slot = (slot + 1) & (s->slot_count - 1);
    return &s->slots[slot];
}

static int make_room(struct obj_symbols *s, size_t length, struct kiln_error *error)
{
    const struct obj_symbols old = *s;
    int status = kiln_grow(&s->text, &s->text_capacity, s->text_size + length + 1, 1, "names", error);
    if (status != KILN_OK || 2 * (s->used + 1) <= s->slot_count)
        return status;
    s->slots = NULL;
    s->slot_count = old.slot_count == 0 ? 64 : 2 * old.slot_count;
    status = kiln_allocate(&s->slots, s->slot_count, sizeof *s->slots, "names", error);
    if (status != KILN_OK) {
        s->slots = old.slots;
        s->slot_count = old.slot_count;
        return status;
    }
    struct obj_symbol *slots = old.slots;
    for (size_t i = 0; i < old.slot_count; i++)
        if (slots[i].taken)
            *slot_of(s, s->text + slots[i].name, slots[i].length, slots[i].hash) = slots[i];
    kiln_free(&slots);
    return KILN_OK;
}

int obj_symbol(struct obj_symbols *s, const char *name, size_t length, uint32_t *value, struct kiln_error *error)
{
    const uint64_t hash = XXH3_64bits(name, length);
    const int status = make_room(s, length, error);
    if (status != KILN_OK)
        return status;
    struct obj_symbol *slot = slot_of(s, name, length, hash);
    if (!slot->taken) {
        memcpy(s->text + s->text_size, name, length);
        *slot = (struct obj_symbol){.name = s->text_size, .length = length, .hash = hash, .value = *value, .taken = 1};
        s->text_size += length;
        s->used++;
    }
    *value = slot->value;
    return KILN_OK;
}

void obj_symbols_destroy(struct obj_symbols *s)
{
    kiln_free(&s->slots);
    kiln_free(&s->text);
    *s = (struct obj_symbols){0};
}
