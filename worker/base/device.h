/* Description of a device that a backend can run on, before it is used: one entry of `kiln info --devices`. */
#ifndef KILN_WORKER_BASE_DEVICE_H
#define KILN_WORKER_BASE_DEVICE_H

#include <stdbool.h>
#include <stdint.h>

/* Properties of a device. Members that make no sense for a CPU are 0. */
struct kiln_device {
    char name[128];   /* as the driver calls it */
    char driver[128]; /* name and version; of Embree its version */
    uint8_t uuid[16];
    /* number for --device: hardware devices come before software ones, each kind sorted by UUID; the same in every
     * process of a node */
    uint32_t index;
    uint32_t api_version; /* VK_MAKE_API_VERSION */
    bool software;        /* runs on the CPU: a software Vulkan driver, or Embree */
    bool fit;             /* kiln can run on it; if not, `lacks` says what is missing */
    char lacks[160];
    bool ray_tracing; /* VK_KHR_ray_tracing_pipeline and its dependencies */
    bool float64;
    uint32_t subgroup;
    uint64_t memory, budget; /* bytes: the largest device-local heap; its free part for this process */
};

/* How a device intersects rays: by traversal of a BVH in compute shaders, or by its ray-tracing pipeline. AUTO: the
 * fastest way on this device. COMPUTE: the fastest BVH on this device. FOUR, EIGHT: the BVH with 4 or 8 children a
 * node. */
enum kiln_traversal {
    KILN_TRAVERSE_AUTO,
    KILN_TRAVERSE_COMPUTE,
    KILN_TRAVERSE_PIPELINE,
    KILN_TRAVERSE_FOUR,
    KILN_TRAVERSE_EIGHT
};

/* Injected faults and settings of a device, for tests. All zero: none. */
struct kiln_device_faults {
    /* Every call of the driver that can fail is counted. LOST: the call `at` says that the device is lost, and so does
     * every one after it until the device is opened anew. MEMORY: the call says that it is out of memory. */
    enum kiln_device_fault { KILN_DEVICE_FAULT_NONE, KILN_DEVICE_FAULT_LOST, KILN_DEVICE_FAULT_MEMORY } kind;
    uint64_t at, every; /* call that fails, counted from 1; again every `every` calls after it; 0: once */
    /* On a software device: memory that nobody may touch after each buffer, or before it. */
    enum kiln_buffer_guard { KILN_GUARD_NONE, KILN_GUARD_AFTER, KILN_GUARD_BEFORE } guard;
    bool makers; /* software devices compile kernels on threads too */
    bool floats; /* all devices are treated as lacking float64 */
    /* builder of the BVH that a device traverses, where there is a choice */
    enum kiln_tree_builder { KILN_TREE_AS_USUAL, KILN_TREE_HOST, KILN_TREE_DEVICE } tree;
};

#endif
