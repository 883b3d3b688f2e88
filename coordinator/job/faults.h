/* Faults that tests inject: what one rank shall do wrong, so that what the others make of it can be seen. They are read
 * from the environment once, with the job, and are handed to whoever is to behave so. No fault is the same as no
 * variable, and a struct that is all zero. Not collective: every rank reads its own environment. */
#ifndef KILN_COORDINATOR_JOB_FAULTS_H
#define KILN_COORDINATOR_JOB_FAULTS_H

#include <stdbool.h>
#include <stdint.h>

#include "worker/base/status.h"

enum { KILN_FAULT_PLACE = 64 }; /* bytes of a place's name, with the zero byte */

struct kiln_faults {
    /* KILN_SLOW_RANK=RANK:FACTOR. The rank takes `slowness` times as long for a batch of samples: 1 to 1,000,000;
     * 0: no rank does. */
    uint32_t slow_rank;
    double slowness;
    /* KILN_HALT_RANK=RANK:PLACE. The rank stops itself (SIGSTOP) when it comes to the place: the name of a phase, a
     * pass or a blocking call, as kiln_watchdog_phase and kiln_watchdog_blocking are told. "": no rank does. */
    uint32_t halt_rank;
    char halt_place[KILN_FAULT_PLACE];
    /* KILN_FAILING_PACKER=RANK. What the rank packs of other ranks' lightmaps fails. */
    bool packer_fails;
    uint32_t failing_packer;
    /* KILN_LOCKS=none. The lock of a bake's folder is taken as on a file system without locks. */
    bool no_locks;
};

/* Reads the environment. KILN_USAGE, with the variable and what it has to be, for a value that is not understood. */
int kiln_faults_read(struct kiln_faults *faults, struct kiln_error *error);

/* How many times the time of a batch this rank shall take: 1 when it is not the slow one. */
double kiln_faults_slowness(const struct kiln_faults *faults, uint32_t rank);
/* Where this rank shall stop itself; NULL: nowhere. Lives as long as `faults`. */
const char *kiln_faults_halt(const struct kiln_faults *faults, uint32_t rank);
/* Whether what this rank packs for others shall fail. `faults` may be NULL: none. */
bool kiln_faults_packer_fails(const struct kiln_faults *faults, uint32_t rank);

#endif
