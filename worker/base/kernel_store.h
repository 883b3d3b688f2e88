/* Storage of compiled kernels between runs, and access to the code of kernels. The worker opens no files but the scene
 * file; so the creator of a backend supplies functions that load, keep and read these files. */
#ifndef KILN_WORKER_BASE_KERNEL_STORE_H
#define KILN_WORKER_BASE_KERNEL_STORE_H

#include <stddef.h>

#include "worker/base/status.h"

enum { KILN_KERNEL_KEY = 32 }; /* hexadecimal digits: 128 bits */

/* `load` and `keep` may be called by several threads at once. All zero: nothing is kept, and no file is read. */
struct kiln_kernel_store {
    const char *place; /* passed to `load` and `keep`; borrowed */
    /* Returns the bytes kept under a key; NULL: none, or they were altered. Free with kiln_free. */
    void *(*load)(const char *place, const char *key, size_t *size);
    /* Keeps bytes under a key. If this fails, the next run compiles the kernel again: no error. */
    void (*keep)(const char *place, const char *key, const void *bytes, size_t size);
    /* Reads the file `name` that is installed with the program, if it has at most `most` bytes. Free *bytes with
     * kiln_free. KILN_NO_DEVICE if it is missing. */
    int (*file)(const char *name, size_t most, char **bytes, size_t *size, struct kiln_error *error);
};

#endif
