/* Checked allocation: every size is count x element size, refused on overflow, aligned to 64 bytes, and accounted
 * for. */
#ifndef KILN_WORKER_BASE_MEMORY_H
#define KILN_WORKER_BASE_MEMORY_H

#include <stddef.h>

#include "worker/base/status.h"

/* Allocates `count` elements of `size` bytes, zeroed and 64-byte aligned, and stores the pointer in *pointer (the
 * address of a pointer variable of any object type). A count of 0 gives a valid pointer too. `what` names the purpose
 * in the error sentence ("the lightmap tiles"). Large arrays take memory where they are written first. Free with
 * kiln_free. */
int kiln_allocate(void *pointer, size_t count, size_t size, const char *what, struct kiln_error *error);

/* As kiln_allocate, but elements are not initialised. */
int kiln_allocate_bare(void *pointer, size_t count, size_t size, const char *what, struct kiln_error *error);

/* Announces that an array of kiln_allocate or kiln_allocate_bare will be written from end to end. A large array then
 * gets large pages, if the system has some, so that it takes fewer page faults. */
void kiln_expect_whole(void *array, size_t count, size_t size);

/* Grows *pointer (from kiln_allocate or NULL) to at least `needed` elements. *capacity is the present number of
 * elements and is updated; a growing array at least doubles. New elements are not initialised. */
int kiln_grow(void *pointer, size_t *capacity, size_t needed, size_t size, const char *what, struct kiln_error *error);

/* Frees *pointer and sets it to NULL; a NULL is ignored. */
void kiln_free(void *pointer);

/* A place for a pointer in front of an array of this file, for who owns it: arena.h chains its arrays there. It is not
 * initialised, and kiln_grow does not copy it. */
void **kiln_memory_link(void *array);

/* An allocator for large, lasting arrays, such as memory that several processes share. `allocate` and `release` promise
 * what kiln_allocate and kiln_free do, but a release may take effect later. Users keep copies of this struct; the
 * context is borrowed. */
struct kiln_allocator {
    int (*allocate)(void *context, void *pointer, size_t count, size_t size, const char *what,
                    struct kiln_error *error);
    void (*release)(void *context, void *pointer);
    void *context;
};

/* The allocator of kiln_allocate and kiln_free. */
extern const struct kiln_allocator kiln_own_memory;

#endif
