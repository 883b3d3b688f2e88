/* What memory this process has, as the kernel counts it. */
#ifndef KILN_COORDINATOR_RUN_PROCESS_MEMORY_H
#define KILN_COORDINATOR_RUN_PROCESS_MEMORY_H

#include <stdint.h>

enum kiln_memory_figure {
    KILN_MEMORY_NOW, /* resident now */
    /* the most that was resident since the program began (ru_maxrss would count what the process was before) */
    KILN_MEMORY_PEAK,
    KILN_MEMORY_SHARE /* resident now, where what n processes map counts an nth for each */
};

/* Bytes; 0 where the system does not say. */
uint64_t kiln_process_memory(enum kiln_memory_figure figure);

#endif
