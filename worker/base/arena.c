#include "worker/base/arena.h"

#include <assert.h>
#include <string.h>

#include "worker/base/memory.h"

/* Takes an array in, if it was allocated. */
static int take(struct kiln_arena *arena, const void *pointer, int status)
{
    void *array;
    if (status != KILN_OK)
        return status;
    memcpy(&array, pointer, sizeof array);
    *kiln_memory_link(array) = arena->last;
    arena->last = array;
    return KILN_OK;
}

/* The place that leads to an array. */
static void **place_of(struct kiln_arena *arena, const void *array)
{
    void **place = &arena->last;
    while (*place != array) {
        assert(*place != NULL); /* the array is another's */
        place = kiln_memory_link(*place);
    }
    return place;
}

int kiln_arena_allocate(struct kiln_arena *arena, void *pointer, size_t count, size_t size, const char *what,
                        struct kiln_error *error)
{
    return take(arena, pointer, kiln_allocate(pointer, count, size, what, error));
}

int kiln_arena_allocate_bare(struct kiln_arena *arena, void *pointer, size_t count, size_t size, const char *what,
                             struct kiln_error *error)
{
    return take(arena, pointer, kiln_allocate_bare(pointer, count, size, what, error));
}

int kiln_arena_grow(struct kiln_arena *arena, void *pointer, size_t *capacity, size_t needed, size_t size,
                    const char *what, struct kiln_error *error)
{
    void *old, *array, *before;
    if (needed <= *capacity)
        return KILN_OK;
    memcpy(&old, pointer, sizeof old);
    if (old == NULL)
        return take(arena, pointer, kiln_grow(pointer, capacity, needed, size, what, error));
    void **place = place_of(arena, old);
    before = *kiln_memory_link(old);
    const int status = kiln_grow(pointer, capacity, needed, size, what, error);
    if (status != KILN_OK)
        return status;
    memcpy(&array, pointer, sizeof array);
    *kiln_memory_link(array) = before;
    *place = array;
    return KILN_OK;
}

void kiln_arena_free(struct kiln_arena *arena, void *pointer)
{
    void *array;
    memcpy(&array, pointer, sizeof array);
    if (array != NULL) {
        void **place = place_of(arena, array);
        *place = *kiln_memory_link(array);
    }
    kiln_free(pointer);
}

void kiln_arena_release(struct kiln_arena *arena)
{
    void *array = arena->last;
    arena->last = NULL;
    while (array != NULL) {
        void *before = *kiln_memory_link(array);
        kiln_free(&array);
        array = before;
    }
}
