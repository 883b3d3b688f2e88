#include "worker/base/memory.h"

#include <assert.h>
#include <stdalign.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

enum { ALIGNMENT = 64 };

/* Before a block lies the address that free() wants, and before it the link: what malloc() and calloc() give is aligned
 * to two pointers, so there is room for both. */
static void **base_of(void *block) { return (void **)block - 1; }
static_assert(alignof(max_align_t) >= 2 * sizeof(void *) && ALIGNMENT >= 2 * sizeof(void *), "no room before a block");

void **kiln_memory_link(void *array) { return (void **)array - 2; }

/* Cleared blocks come from calloc(), which leaves large ones to the system: their pages are cleared when first written,
 * by the thread that writes them. */
static void *aligned_block(size_t count, size_t size, bool cleared)
{
    if (size != 0 && count > (SIZE_MAX - ALIGNMENT) / size)
        return NULL;
    const size_t bytes = count * size + ALIGNMENT;
    unsigned char *base = cleared ? calloc(1, bytes) : malloc(bytes);
    if (base == NULL)
        return NULL;
    void *block = base + (ALIGNMENT - (uintptr_t)base % ALIGNMENT);
    *base_of(block) = base;
    return block;
}

static int allocate(void *pointer, size_t count, size_t size, bool cleared, const char *what, struct kiln_error *error)
{
    void *block = aligned_block(count, size, cleared);
    memcpy(pointer, &block, sizeof block);
    if (block == NULL)
        return kiln_fail(error, KILN_SYSTEM, "out of memory: %zu elements of %zu bytes for %s", count, size, what);
    return KILN_OK;
}

int kiln_allocate_bare(void *pointer, size_t count, size_t size, const char *what, struct kiln_error *error)
{
    return allocate(pointer, count, size, false, what, error);
}

int kiln_allocate(void *pointer, size_t count, size_t size, const char *what, struct kiln_error *error)
{
    return allocate(pointer, count, size, true, what, error);
}

void kiln_expect_whole(void *array, size_t count, size_t size)
{
    enum { LEAST = 1 << 22 };
    const uintptr_t page = (uintptr_t)sysconf(_SC_PAGESIZE), begin = ((uintptr_t)array + page - 1) / page * page,
                    end = ((uintptr_t)array + count * size) / page * page;
    if (count * size >= LEAST)
        (void)madvise((void *)begin, end - begin, MADV_HUGEPAGE);
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
    void *block = aligned_block(target, size, false);
    if (block == NULL)
        return kiln_fail(error, KILN_SYSTEM, "out of memory: %zu elements of %zu bytes for %s", target, size, what);
    if (old != NULL)
        memcpy(block, old, *capacity * size);
    kiln_free(&old);
    memcpy(pointer, &block, sizeof block);
    *capacity = target;
    return KILN_OK;
}

void kiln_free(void *pointer)
{
    void *block;
    memcpy(&block, pointer, sizeof block);
    if (block != NULL)
        free(*base_of(block));
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
