/* Ray tracer of a device: compute shaders that traverse one of the BVH's layouts, or the device's own ray tracing. */
#ifndef KILN_WORKER_BACKEND_VULKAN_TRACER_H
#define KILN_WORKER_BACKEND_VULKAN_TRACER_H

#include "worker/backend/backend.h"
#include "worker/backend/vulkan/acceleration.h"
#include "worker/backend/vulkan/bvh_device.h"
#include "worker/backend/vulkan/gpu/gpu.h"

struct vulkan_backend;

/* Origin of the BVH for compute traversal: built by the host, built by the device, or built by the device and laid out
 * by the host. */
enum vulkan_tree { VULKAN_TREE_OF_HOST, VULKAN_TREE_OF_DEVICE, VULKAN_TREE_FETCHED };

struct vulkan_tracer {
    uint32_t traversal; /* KILN_TRAVERSAL_*: the specialisation constant */
    enum vulkan_tree tree;
    struct gpu_buffer nodes, triangles;
    struct acceleration *acceleration; /* NULL: compute */
    struct kiln_gpu_trace layout;
    double rate; /* rays per second in the trial; 0: no trial */
};

/* Builds the tracer that params.traversal requests. AUTO on a hardware device times the four-wide BVH and the pipeline
 * with diffuse rays of the scene, for some 50 ms each. It takes the pipeline only if that is a quarter faster, so that
 * a choice between nearly equal ones, whose hits differ in the last bits, does not depend on chance. COMPUTE takes the
 * four-wide BVH. On software devices both take the eight-wide one. Both layouts find the same hits. The rest of the
 * scene must be on the device.
 *
 * The device builds the tree (bvh_device.h) under these conditions: it is a hardware device with enough memory, rays
 * can hit at least BVH_DEVICE_LEAST triangles, and so few rays a triangle are expected that this is faster in all. It
 * makes the four-wide layout in a few milliseconds. Otherwise Embree builds the tree (bvh.h). A tree of the device that
 * is too deep for four-wide traversal is fetched, split evenly where it is too deep, and laid out by the host.
 * vulkan_tracer_name tells which was used. KILN_NO_DEVICE when the pipeline is requested and not available. */
int vulkan_tracer_create(struct vulkan_backend *b, struct kiln_error *error);
/* Whether the device's own ray tracing may be used. If few rays are expected (params.rays) AUTO behaves as COMPUTE:
 * starting and timing ray tracing would take longer than all rays. */
bool vulkan_tracer_may_be_pipeline(const struct kiln_backend_params *params);
void vulkan_tracer_destroy(struct gpu *gpu, struct vulkan_tracer *tracer);
const char *vulkan_tracer_name(const struct vulkan_tracer *tracer);

/* Makes the rays of the trial: about `count` diffuse rays from triangles in their stored order, as a bounce makes them;
 * origins in metres, unit directions. `threads`: of the host. */
void vulkan_tracer_rays(const struct kiln_geometry *geometry, uint32_t count, uint32_t threads,
                        struct kiln_vec3 *origins, struct kiln_vec3 *directions);

#endif
