/* Fault injection for tests: makes a rank or its device misbehave, so that the reaction of the others can be tested.
 * The faults are read from the environment once, with the job, and passed to the code that simulates them. Without
 * variables the struct is all zeros. Not collective: every rank reads its own environment. */
#ifndef KILN_COORDINATOR_JOB_FAULTS_H
#define KILN_COORDINATOR_JOB_FAULTS_H

#include <stdbool.h>
#include <stdint.h>

#include "worker/base/device.h"
#include "worker/base/status.h"

enum { KILN_FAULT_PATH = 512, KILN_FAULT_PLACE = 64 }; /* bytes of the name of a place, with the zero byte */

struct kiln_faults {
    /* KILN_SLOW_RANK=RANK:FACTOR. The rank takes `slowness` times as long for each batch, 1 to 1,000,000; 0: no rank
     * is slow. */
    uint32_t slow_rank;
    double slowness;
    /* KILN_HALT_RANK=RANK:PLACE. The rank stops itself (SIGSTOP) when it reaches the place: the name of a phase, a pass
     * or a blocking call, as given to kiln_watchdog_phase and kiln_watchdog_blocking; or "saved PASS": when it has
     * saved a checkpoint within that pass (coordinator/run/control.h), also without a watchdog. "": no rank does. */
    uint32_t halt_rank;
    char halt_place[KILN_FAULT_PLACE];
    /* KILN_HOLD=FILE. While the file exists, the rank stays in the first batch of a gather pass, until it is asked to
     * stop: so a test can act during a bake on any machine. "": no rank waits. */
    char hold[KILN_FAULT_PATH];
    /* KILN_FAILING_PACKER=RANK. The rank fails to compress its band of a lightmap, or strips of other ranks'
     * lightmaps. */
    bool packer_fails;
    uint32_t failing_packer;
    /* KILN_DIVIDE_FROM=TEXELS. Lightmaps of at least so many texels are divided into bands if they are large among the
     * others, or else packed by several ranks; 0: as struct kiln_output_params has it. */
    uint64_t divide_from;
    /* KILN_EXCHANGE_LIMIT=ELEMENTS, 1 to 2^31, the same on every rank: the most in one call of MPI; 0: the largest
     * count that MPI takes. */
    uint64_t exchange_limit;
    /* KILN_DISPATCH_TIME=MILLISECONDS, 1 to 60,000: the longest that one dispatch of a device may take; 0: 100. */
    double dispatch_time;
    /* KILN_SIGHT=none. The visibility grid is empty, so that all ray hits are unexpected. */
    bool no_sight;
    /* KILN_LOCKS=none. The lock of a bake's folder behaves as on a file system without locks. */
    bool no_locks;
    /* KILN_PROBES=plain. Radiance probes stay at their grid positions, even inside geometry, and every point counts its
     * eight probes as visible: the behaviour without coordinator/integrate/probes/radiance_sight.h. */
    bool plain_probes;
    /* KILN_TRAVERSAL=compute, pipeline, four or eight: ray traversal on a device, for measurements and in case of
     * faulty drivers; the same on every rank (mpirun -x KILN_TRAVERSAL). */
    enum kiln_traversal traversal;
    /* KILN_GPU_FAULT=lost:K, memory:K, or either with :N after it: the K-th call of a device's driver fails, and again
     * every N calls after it. KILN_VULKAN_GUARD=after, before, or 0 for none: guarded buffers
     * (worker/backend/vulkan/gpu/gpu.h). KILN_KERNEL_MAKERS=all: a software device's kernels are made by threads too.
     * KILN_DOUBLES=none: devices are taken for such as have no doubles.
     * KILN_TREE=host or device: who builds the tree that a device walks (worker/backend/vulkan/tracer.h).
     */
    struct kiln_device_faults device;
};

/* Reads the environment. KILN_USAGE, with the variable and its valid values, for a value that is not valid. */
int kiln_faults_read(struct kiln_faults *faults, struct kiln_error *error);

/* Factor on the time of a batch on this rank; 1 if it is not the slow one. */
double kiln_faults_slowness(const struct kiln_faults *faults, uint32_t rank);
/* The place at which this rank stops itself; NULL: none. Valid as long as `faults`. */
const char *kiln_faults_halt(const struct kiln_faults *faults, uint32_t rank);
/* Whether this rank fails to pack for other ranks. `faults` may be NULL: no faults. */
bool kiln_faults_packer_fails(const struct kiln_faults *faults, uint32_t rank);

#endif
