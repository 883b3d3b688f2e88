/* Ray tracer of a device: one of the BVH's layouts walked by compute shaders, or the device's own ray tracing. */
#ifndef KILN_WORKER_BACKEND_VULKAN_TRACER_H
#define KILN_WORKER_BACKEND_VULKAN_TRACER_H

#include "worker/backend/backend.h"
#include "worker/backend/vulkan/acceleration.h"
#include "worker/backend/vulkan/bvh_device.h"
#include "worker/backend/vulkan/gpu/gpu.h"

struct vulkan_backend;

/* Who has built the tree of compute traversal: the host, the device, or the device for the host to lay it out. */
enum vulkan_tree { VULKAN_TREE_OF_HOST, VULKAN_TREE_OF_DEVICE, VULKAN_TREE_FETCHED };

struct vulkan_tracer {
    uint32_t traversal; /* KILN_TRAVERSAL_*: the specialisation constant */
    enum vulkan_tree tree;
    struct gpu_buffer nodes, triangles;
    struct acceleration *acceleration; /* NULL: compute */
    struct kiln_gpu_trace layout;
    double rate; /* rays per second when it was tried, 0: it was not */
};

/* Builds what params.traversal asks for. AUTO on a real device: times the four-wide BVH and the pipeline with diffuse
 * rays of the scene, for some 50 ms each, and takes the pipeline only when it is a quarter faster, so that a choice
 * between near equals, whose hits differ in the last bits, does not depend on the day. COMPUTE: the four-wide BVH. On
 * software devices both take the eight-wide one. Both layouts find the same hits. The rest of the scene must be on the
 * device.
 *
 * The tree is the device's own (bvh_device.h) where the device is a real one, has room for that, and rays can hit at
 * least BVH_DEVICE_LEAST triangles, and no more rays a triangle are to come than it is quicker for; its four-wide
 * layout the device makes in a few milliseconds. Else, and for software devices, it is Embree's (bvh.h). A tree of the
 * device's that is too deep for the four-wide walk is fetched, cut evenly where it is too deep, and laid out by the
 * host. vulkan_tracer_name says which. KILN_NO_DEVICE when the pipeline is asked for and not there. */
int vulkan_tracer_create(struct vulkan_backend *b, struct kiln_error *error);
/* Whether the device's own ray tracing may be asked for. Where few rays are expected (params.rays) AUTO does as
 * COMPUTE: to start ray tracing and to try it would take longer than all rays. */
bool vulkan_tracer_may_be_pipeline(const struct kiln_backend_params *params);
void vulkan_tracer_destroy(struct gpu *gpu, struct vulkan_tracer *tracer);
const char *vulkan_tracer_name(const struct vulkan_tracer *tracer);

/* The rays that both are tried with: `count` diffuse ones from triangles in their stored order, as a bounce makes
 * them, about; origins in metres, unit directions. `threads` of the host. */
void vulkan_tracer_rays(const struct kiln_geometry *geometry, uint32_t count, uint32_t threads,
                        struct kiln_vec3 *origins, struct kiln_vec3 *directions);

#endif
