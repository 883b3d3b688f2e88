/* Memory use of this process, as the kernel counts it (/proc/self). */
#ifndef KILN_COORDINATOR_RUN_PROCESS_MEMORY_H
#define KILN_COORDINATOR_RUN_PROCESS_MEMORY_H

#include <stdint.h>

enum kiln_memory_figure {
    KILN_MEMORY_NOW, /* resident now */
    /* peak resident since the program began (ru_maxrss would include the process before exec) */
    KILN_MEMORY_PEAK,
    KILN_MEMORY_SHARE /* resident now; a page that n processes map counts 1/n (proportional set size) */
};

/* Returns bytes; 0 if the system does not provide the figure. */
uint64_t kiln_process_memory(enum kiln_memory_figure figure);

#endif
