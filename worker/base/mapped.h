/* A watch over mapped files: what happens when another process shortens one while it is mapped.
 *
 * Reading a mapped page that the file no longer has, or that its disk cannot deliver, raises SIGBUS. If the address
 * lies in a mapping that is watched, the process writes one sentence with the file's name to stderr and exits with
 * KILN_IO. Any other SIGBUS goes to the handler that was there before. The table of mappings and the handler belong to
 * the process, as signals do: they are the only state of kiln that is global. Threads may call these functions at any
 * time; the signal handler reads the table without locks. Mappings beyond the table's size are not watched. */
#ifndef KILN_WORKER_BASE_MAPPED_H
#define KILN_WORKER_BASE_MAPPED_H

#include <stddef.h>

/* Starts to watch a mapping. `name` is copied. */
void kiln_mapped_watch(const void *base, size_t size, const char *name);
/* Stops watching; call it before munmap. A mapping that is not watched is ignored. */
void kiln_mapped_forget(const void *base);

#endif
