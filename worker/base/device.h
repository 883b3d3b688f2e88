/* Description of a device that a backend can run on, before it is used: one entry of `kiln info --devices`. */
#ifndef KILN_WORKER_BASE_DEVICE_H
#define KILN_WORKER_BASE_DEVICE_H

#include <stdbool.h>
#include <stdint.h>

/* Device properties; those a CPU lacks are 0. */
struct kiln_device {
    char name[128];   /* as the driver calls it */
    char driver[128]; /* name and version; of Embree its version */
    uint8_t uuid[16];
    /* --device: real devices before software ones, each kind by UUID, the same in every process of a node */
    uint32_t index;
    uint32_t api_version; /* VK_MAKE_API_VERSION */
    bool software;        /* a CPU that plays a GPU, or is what it is */
    bool fit;             /* has what kiln needs; else `lacks` says what not */
    char lacks[160];
    bool ray_tracing; /* VK_KHR_ray_tracing_pipeline and what it needs */
    bool float64;
    uint32_t subgroup;
    uint64_t memory, budget; /* bytes: of the largest device-local heap; of it, free for this process */
};

/* How a device finds hits: by walking a BVH in compute shaders, or by its own ray-tracing pipeline. AUTO: what is
 * fastest here. COMPUTE: the BVH that is fastest here. FOUR and EIGHT: the BVH with so many children a node. */
enum kiln_traversal {
    KILN_TRAVERSE_AUTO,
    KILN_TRAVERSE_COMPUTE,
    KILN_TRAVERSE_PIPELINE,
    KILN_TRAVERSE_FOUR,
    KILN_TRAVERSE_EIGHT
};

/* Faults and settings that tests give a device. All zero: none. */
struct kiln_device_faults {
    /* Every call of the driver that can fail is counted. LOST: the call `at` says that the device is lost, and so does
     * every one after it until the device is opened anew. MEMORY: the call says that it is out of memory. */
    enum kiln_device_fault { KILN_DEVICE_FAULT_NONE, KILN_DEVICE_FAULT_LOST, KILN_DEVICE_FAULT_MEMORY } kind;
    uint64_t at, every; /* the first is call 1; again every so many calls after it; 0: once */
    /* On a software device: memory that nobody may touch after each buffer, or before it. */
    enum kiln_buffer_guard { KILN_GUARD_NONE, KILN_GUARD_AFTER, KILN_GUARD_BEFORE } guard;
    bool makers; /* a software device's kernels are made by threads too */
    bool floats; /* devices are taken for such as have no doubles */
    /* who builds the tree that a device walks, wherever that can be done */
    enum kiln_tree_builder { KILN_TREE_AS_USUAL, KILN_TREE_HOST, KILN_TREE_DEVICE } tree;
};

#endif
