#include "worker/base/memory.h"

#include <stdint.h>
#include <stdlib.h>
#include <string.h>

enum { ALIGNMENT = 64 };

static void *aligned_block(size_t count, size_t size)
{
    if (size != 0 && count > (SIZE_MAX - ALIGNMENT) / size)
        return NULL;
    const size_t bytes = (count * size + ALIGNMENT - 1) / ALIGNMENT * ALIGNMENT;
    return aligned_alloc(ALIGNMENT, bytes == 0 ? ALIGNMENT : bytes);
}

int kiln_allocate_bare(void *pointer, size_t count, size_t size, const char *what, struct kiln_error *error)
{
    void *block = aligned_block(count, size);
    memcpy(pointer, &block, sizeof block);
    if (block == NULL)
        return kiln_fail(error, KILN_SYSTEM, "out of memory: %zu elements of %zu bytes for %s", count, size, what);
    return KILN_OK;
}

int kiln_allocate(void *pointer, size_t count, size_t size, const char *what, struct kiln_error *error)
{
    const int status = kiln_allocate_bare(pointer, count, size, what, error);
    void *block;
    memcpy(&block, pointer, sizeof block);
    if (status == KILN_OK)
        memset(block, 0, count * size);
    return status;
}

int kiln_grow(void *pointer, size_t *capacity, size_t needed, size_t size, const char *what, struct kiln_error *error)
{
    if (needed <= *capacity)
        return KILN_OK;
    size_t target = *capacity < 16 ? 16 : *capacity;
    while (target < needed) {
        if (target > SIZE_MAX / 2)
            return kiln_fail(error, KILN_SYSTEM, "out of memory: %zu elements for %s", needed, what);
        target *= 2;
    }
    void *old;
    memcpy(&old, pointer, sizeof old);
    void *block = aligned_block(target, size);
    if (block == NULL)
        return kiln_fail(error, KILN_SYSTEM, "out of memory: %zu elements of %zu bytes for %s", target, size, what);
    if (old != NULL)
        memcpy(block, old, *capacity * size);
    free(old);
    memcpy(pointer, &block, sizeof block);
    *capacity = target;
    return KILN_OK;
}

void kiln_free(void *pointer)
{
    void *block;
    memcpy(&block, pointer, sizeof block);
    free(block);
    block = NULL;
    memcpy(pointer, &block, sizeof block);
}

static int allocate_own(void *context, void *pointer, size_t count, size_t size, const char *what,
                        struct kiln_error *error)
{
    (void)context;
    return kiln_allocate(pointer, count, size, what, error);
}

static void release_own(void *context, void *pointer)
{
    (void)context;
    kiln_free(pointer);
}

const struct kiln_allocator kiln_own_memory = {.allocate = allocate_own, .release = release_own};
