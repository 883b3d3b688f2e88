/* Files that are mapped for long, and what happens when one is cut short meanwhile.
 *
 * Reading a mapped page that the file no longer has, or that its disk cannot deliver, is SIGBUS. Where the address lies
 * in a mapping that is watched here, the process writes one sentence with the file's name to stderr and ends with
 * KILN_IO; any other SIGBUS goes where it went before. The table of mappings and the handler are the process's own, as
 * signals are: the one thing that is kept outside of handles here. Threads may call these at any time; the handler
 * reads the table without locks. Mappings beyond the table's size are not watched. */
#ifndef KILN_WORKER_BASE_MAPPED_H
#define KILN_WORKER_BASE_MAPPED_H

#include <stddef.h>

/* `name` is copied. */
void kiln_mapped_watch(const void *base, size_t size, const char *name);
/* Before munmap; a mapping that is not watched is fine. */
void kiln_mapped_forget(const void *base);

#endif
