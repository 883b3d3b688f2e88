/* Arrays that live and die together: the parts of an object, or all that a function works with. An arena owns the
 * arrays that are allocated in it, and one call frees them all. Each is an array of memory.h of its own, with its
 * limits, its zeroes and its sentences of errors. */
#ifndef KILN_WORKER_BASE_ARENA_H
#define KILN_WORKER_BASE_ARENA_H

#include <stddef.h>

#include "worker/base/status.h"

/* An empty one is all zero. It belongs to one thread at a time, and who moves it (copies it and forgets the first one)
 * moves what it owns. */
struct kiln_arena {
    void *last; /* the array that came last; each is chained to the one before */
};

/* As kiln_allocate, kiln_allocate_bare and kiln_grow; the arena owns the array. */
int kiln_arena_allocate(struct kiln_arena *arena, void *pointer, size_t count, size_t size, const char *what,
                        struct kiln_error *error);
int kiln_arena_allocate_bare(struct kiln_arena *arena, void *pointer, size_t count, size_t size, const char *what,
                             struct kiln_error *error);
int kiln_arena_grow(struct kiln_arena *arena, void *pointer, size_t *capacity, size_t needed, size_t size,
                    const char *what, struct kiln_error *error);

/* Frees one array before the others, where its memory counts, and sets *pointer to NULL; a NULL is ignored. Walks over
 * the arrays that came after it. */
void kiln_arena_free(struct kiln_arena *arena, void *pointer);

/* Frees all arrays, the last one first, and leaves the arena empty. It may stand in one of its arrays. Pointers to them
 * keep their values, and must not be read. */
void kiln_arena_release(struct kiln_arena *arena);

#endif
