/* Memory that this host lets its processes take. */
#ifndef KILN_COORDINATOR_RUN_HOST_MEMORY_H
#define KILN_COORDINATOR_RUN_HOST_MEMORY_H

#include <stdint.h>

/* Bytes: the machine's memory, or the least limit of the control groups that this process is in, where that is less. */
uint64_t kiln_host_memory(void);

/* The same from given files: `groups`: as /proc/self/cgroup; `folder`: where the hierarchies of control groups are. For
 * tests. */
uint64_t kiln_host_memory_of(uint64_t machine, const char *groups, const char *folder);

#endif
