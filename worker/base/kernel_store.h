/* Where compiled kernels are kept from one run to the next, and where code of kernels is read. The worker knows no
 * files but the scene file: whoever creates a backend says where they are and how they are read and written. */
#ifndef KILN_WORKER_BASE_KERNEL_STORE_H
#define KILN_WORKER_BASE_KERNEL_STORE_H

#include <stddef.h>

#include "worker/base/status.h"

enum { KILN_KERNEL_KEY = 32 }; /* hexadecimal digits: 128 bits */

/* The first two functions may be called by several threads at once. All zero: nothing is kept, and no file is read. */
struct kiln_kernel_store {
    const char *place; /* handed to both; borrowed */
    /* The bytes that were kept under a key, as they were; NULL: there are none, or they have changed. Free with
     * kiln_free. */
    void *(*load)(const char *place, const char *key, size_t *size);
    /* Keeps bytes under a key. What cannot be kept is made anew in the next run: no error. */
    void (*keep)(const char *place, const char *key, const void *bytes, size_t size);
    /* Reads the file NAME, of at most `most` bytes, that comes with the program. Free *bytes with kiln_free.
     * KILN_NO_DEVICE where it is missing. */
    int (*file)(const char *name, size_t most, char **bytes, size_t *size, struct kiln_error *error);
};

#endif
