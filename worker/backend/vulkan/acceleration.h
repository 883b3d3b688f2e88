/* The world's triangles in the device's own acceleration structure, for VK_KHR_ray_tracing_pipeline
 * (shaders/trace/pipeline.glsl).
 *
 * There is one bottom level of two geometries, as in the Embree backend: 0 the opaque triangles, 1 those that may let
 * rays through. One top level holds one instance of it, untransformed. */
#ifndef KILN_WORKER_BACKEND_VULKAN_ACCELERATION_H
#define KILN_WORKER_BACKEND_VULKAN_ACCELERATION_H

#include <stdbool.h>
#include <stdint.h>

#include "worker/backend/vulkan/gpu/gpu.h"
#include "worker/scene/geometry.h"

struct acceleration;

/* Whether an acceleration structure can hold the geometry's triangles: at most 2^32 bytes of indices. */
bool acceleration_can(const struct kiln_geometry *geometry);
/* Builds the structure on a device whose description says ray_tracing, and waits for the end. Vertices and indices are
 * on the device only meanwhile. The gpu is borrowed and must outlive it. KILN_NO_DEVICE when the device refuses, with
 * its reason. */
int acceleration_create(struct acceleration **acceleration, struct gpu *gpu, const struct kiln_geometry *geometry,
                        struct kiln_error *error);
void acceleration_destroy(struct acceleration **acceleration);

/* Returns the address for struct kiln_gpu_trace.top_level. */
uint64_t acceleration_address(const struct acceleration *acceleration);

#endif
