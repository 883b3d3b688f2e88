#include "worker/backend/vulkan/acceleration.h"

#include "worker/backend/vulkan/gpu/private.h"
#include "worker/base/memory.h"

struct calls {
    PFN_vkGetAccelerationStructureBuildSizesKHR sizes;
    PFN_vkCreateAccelerationStructureKHR create;
    PFN_vkDestroyAccelerationStructureKHR destroy;
    PFN_vkGetAccelerationStructureDeviceAddressKHR address;
    PFN_vkCmdBuildAccelerationStructuresKHR build;
};

struct level {
    VkAccelerationStructureKHR handle;
    struct gpu_buffer memory;
    uint64_t address;
};

struct acceleration {
    struct gpu *gpu;
    struct calls calls;
    struct level bottom, top;
};

static int load_calls(struct acceleration *a, struct kiln_error *error)
{
    VkDevice device = gpu_vk_device(a->gpu);
    a->calls = (struct calls){
        .sizes = (PFN_vkGetAccelerationStructureBuildSizesKHR)vkGetDeviceProcAddr(
            device, "vkGetAccelerationStructureBuildSizesKHR"),
        .create = (PFN_vkCreateAccelerationStructureKHR)vkGetDeviceProcAddr(device, "vkCreateAccelerationStructureKHR"),
        .destroy =
            (PFN_vkDestroyAccelerationStructureKHR)vkGetDeviceProcAddr(device, "vkDestroyAccelerationStructureKHR"),
        .address = (PFN_vkGetAccelerationStructureDeviceAddressKHR)vkGetDeviceProcAddr(
            device, "vkGetAccelerationStructureDeviceAddressKHR"),
        .build = (PFN_vkCmdBuildAccelerationStructuresKHR)vkGetDeviceProcAddr(device,
                                                                              "vkCmdBuildAccelerationStructuresKHR")};
    if (a->calls.sizes == NULL || a->calls.create == NULL || a->calls.destroy == NULL || a->calls.address == NULL ||
        a->calls.build == NULL)
        return kiln_fail(error, KILN_NO_DEVICE, "%s has no acceleration structures; set KILN_TRAVERSAL=compute",
                         gpu_about(a->gpu)->name);
    return KILN_OK;
}

/* Scratch memory must begin at a multiple of what the device says (a power of two). */
static uint64_t scratch_alignment(const struct gpu *gpu)
{
    VkPhysicalDeviceAccelerationStructurePropertiesKHR own = {
        .sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_ACCELERATION_STRUCTURE_PROPERTIES_KHR};
    VkPhysicalDeviceProperties2 properties = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_PROPERTIES_2, .pNext = &own};
    vkGetPhysicalDeviceProperties2(gpu->physical, &properties);
    return own.minAccelerationStructureScratchOffsetAlignment > 1 ? own.minAccelerationStructureScratchOffsetAlignment
                                                                  : 1;
}

/* ---- building one level ---- */

struct work {
    struct acceleration *a;
    VkAccelerationStructureBuildGeometryInfoKHR info;
    const VkAccelerationStructureBuildRangeInfoKHR *ranges;
};

static void record_build(VkCommandBuffer commands, void *context)
{
    const struct work *w = context;
    w->a->calls.build(commands, 1, &w->info, &w->ranges);
}

static int create_handle(struct acceleration *a, struct level *level, VkAccelerationStructureTypeKHR type,
                         uint64_t size, struct kiln_error *error)
{
    int status = gpu_buffer_create(a->gpu, &level->memory, size, GPU_DEVICE, "the acceleration structure", error);
    if (status != KILN_OK)
        return status;
    const VkAccelerationStructureCreateInfoKHR info = {.sType =
                                                           VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_CREATE_INFO_KHR,
                                                       .buffer = gpu_vk_buffer(&level->memory),
                                                       .size = size,
                                                       .type = type};
    const VkResult result = GPU_TRY(a->gpu, a->calls.create(gpu_vk_device(a->gpu), &info, NULL, &level->handle));
    if (result != VK_SUCCESS)
        return gpu_failure(a->gpu, result, error, "cannot create an acceleration structure of %llu bytes",
                           (unsigned long long)size);
    const VkAccelerationStructureDeviceAddressInfoKHR where = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_DEVICE_ADDRESS_INFO_KHR,
        .accelerationStructure = level->handle};
    level->address = a->calls.address(gpu_vk_device(a->gpu), &where);
    return KILN_OK;
}

/* `ranges` has one entry for each of the geometries. */
static int build_level(struct acceleration *a, struct level *level, VkAccelerationStructureTypeKHR type,
                       const VkAccelerationStructureGeometryKHR *geometries,
                       const VkAccelerationStructureBuildRangeInfoKHR *ranges, uint32_t count, struct kiln_error *error)
{
    struct work w = {.a = a,
                     .ranges = ranges,
                     .info = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_GEOMETRY_INFO_KHR,
                              .type = type,
                              .flags = VK_BUILD_ACCELERATION_STRUCTURE_PREFER_FAST_TRACE_BIT_KHR,
                              .mode = VK_BUILD_ACCELERATION_STRUCTURE_MODE_BUILD_KHR,
                              .geometryCount = count,
                              .pGeometries = geometries}};
    const uint32_t primitives[2] = {ranges[0].primitiveCount, count > 1 ? ranges[1].primitiveCount : 0};
    VkAccelerationStructureBuildSizesInfoKHR sizes = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_BUILD_SIZES_INFO_KHR};
    a->calls.sizes(gpu_vk_device(a->gpu), VK_ACCELERATION_STRUCTURE_BUILD_TYPE_DEVICE_KHR, &w.info, primitives, &sizes);
    struct gpu_buffer scratch = {.size = 0};
    const uint64_t alignment = scratch_alignment(a->gpu);
    int status;
    KILN_TRY(create_handle(a, level, type, sizes.accelerationStructureSize, error));
    KILN_TRY(gpu_buffer_create(a->gpu, &scratch, sizes.buildScratchSize + alignment, GPU_DEVICE,
                               "building the acceleration structure", error));
    w.info.dstAccelerationStructure = level->handle;
    w.info.scratchData.deviceAddress = (scratch.address + alignment - 1) & ~(alignment - 1);
    KILN_TRY(gpu_run_commands(a->gpu, record_build, &w, NULL, error));
end:
    gpu_buffer_destroy(a->gpu, &scratch);
    return status;
}

/* ---- the two levels ---- */

static VkAccelerationStructureGeometryKHR triangles_of(const struct kiln_geometry *g, const struct gpu_buffer *vertices,
                                                       const struct gpu_buffer *indices, VkGeometryFlagsKHR flags)
{
    return (VkAccelerationStructureGeometryKHR){
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
        .geometryType = VK_GEOMETRY_TYPE_TRIANGLES_KHR,
        .geometry.triangles = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_TRIANGLES_DATA_KHR,
                               .vertexFormat = VK_FORMAT_R32G32B32_SFLOAT,
                               .vertexData.deviceAddress = vertices->address,
                               .vertexStride = 3 * sizeof(float),
                               .maxVertex = g->vertex_count > 0 ? (uint32_t)(g->vertex_count - 1) : 0,
                               .indexType = VK_INDEX_TYPE_UINT32,
                               .indexData.deviceAddress = indices->address},
        .flags = flags};
}

static int build_bottom(struct acceleration *a, const struct kiln_geometry *g, const struct gpu_buffer *vertices,
                        const struct gpu_buffer *indices, struct kiln_error *error)
{
    /* alpha tests may run more than once for a triangle, summing of transmittance may not */
    const VkGeometryFlagsKHR once =
        g->passage >= KILN_PASSAGE_BLEND ? VK_GEOMETRY_NO_DUPLICATE_ANY_HIT_INVOCATION_BIT_KHR : 0;
    const VkAccelerationStructureGeometryKHR geometries[2] = {
        triangles_of(g, vertices, indices, VK_GEOMETRY_OPAQUE_BIT_KHR), triangles_of(g, vertices, indices, once)};
    const VkAccelerationStructureBuildRangeInfoKHR ranges[2] = {
        {.primitiveCount = (uint32_t)(g->opaque_count - g->opaque_receivers)},
        {.primitiveCount = (uint32_t)(g->triangle_count - g->opaque_count - g->alpha_receivers),
         .primitiveOffset = (uint32_t)(g->opaque_count * 3 * sizeof(uint32_t))}};
    return build_level(a, &a->bottom, VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR, geometries, ranges, 2, error);
}

/* Builds the top level. Fronts: without flags, a triangle's front is on the side of cross(b - a, c - a). */
static int build_top(struct acceleration *a, struct kiln_error *error)
{
    const VkAccelerationStructureInstanceKHR instance = {
        .transform = {{{1.0f, 0.0f, 0.0f, 0.0f}, {0.0f, 1.0f, 0.0f, 0.0f}, {0.0f, 0.0f, 1.0f, 0.0f}}},
        .mask = 0xff,
        .flags = VK_GEOMETRY_INSTANCE_TRIANGLE_FACING_CULL_DISABLE_BIT_KHR,
        .accelerationStructureReference = a->bottom.address};
    struct gpu_buffer instances = {.size = 0}; /* aligned to 64 bytes; 16 are required */
    int status =
        gpu_buffer_of(a->gpu, &instances, &instance, sizeof instance, "the acceleration structure's instance", error);
    const VkAccelerationStructureGeometryKHR geometry = {
        .sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_KHR,
        .geometryType = VK_GEOMETRY_TYPE_INSTANCES_KHR,
        .geometry.instances = {.sType = VK_STRUCTURE_TYPE_ACCELERATION_STRUCTURE_GEOMETRY_INSTANCES_DATA_KHR,
                               .data.deviceAddress = instances.address}};
    const VkAccelerationStructureBuildRangeInfoKHR range = {.primitiveCount = 1};
    if (status == KILN_OK)
        status = build_level(a, &a->top, VK_ACCELERATION_STRUCTURE_TYPE_TOP_LEVEL_KHR, &geometry, &range, 1, error);
    gpu_buffer_destroy(a->gpu, &instances);
    return status;
}

static int build(struct acceleration *a, const struct kiln_geometry *g, struct kiln_error *error)
{
    struct gpu_buffer vertices = {.size = 0}, indices = {.size = 0};
    int status =
        gpu_buffer_of(a->gpu, &vertices, g->vertices, g->vertex_count * 3 * sizeof(float), "the vertices", error);
    if (status == KILN_OK)
        status = gpu_buffer_of(a->gpu, &indices, g->indices, g->triangle_count * 3 * sizeof(uint32_t), "the triangles",
                               error);
    if (status == KILN_OK)
        status = build_bottom(a, g, &vertices, &indices, error);
    gpu_buffer_destroy(a->gpu, &vertices);
    gpu_buffer_destroy(a->gpu, &indices);
    return status == KILN_OK ? build_top(a, error) : status;
}

/* Offsets into the index buffer are 32 bits wide. */
static const uint64_t MOST_TRIANGLES = UINT32_MAX / (3 * sizeof(uint32_t));

bool acceleration_can(const struct kiln_geometry *geometry) { return geometry->triangle_count <= MOST_TRIANGLES; }

static int check_size(const struct kiln_geometry *g, struct kiln_error *error)
{
    if (acceleration_can(g))
        return KILN_OK;
    return kiln_fail(error, KILN_NO_DEVICE,
                     "%zu triangles are more than the ray-tracing pipeline takes (%llu); do not set "
                     "KILN_TRAVERSAL=pipeline",
                     g->triangle_count, (unsigned long long)MOST_TRIANGLES);
}

int acceleration_create(struct acceleration **acceleration, struct gpu *gpu, const struct kiln_geometry *geometry,
                        struct kiln_error *error)
{
    *acceleration = NULL;
    int status = check_size(geometry, error);
    struct acceleration *a = NULL;
    if (status == KILN_OK)
        status = kiln_allocate(&a, 1, sizeof *a, "the acceleration structure", error);
    if (status != KILN_OK)
        return status;
    a->gpu = gpu;
    status = load_calls(a, error);
    if (status == KILN_OK)
        status = build(a, geometry, error);
    if (status != KILN_OK)
        acceleration_destroy(&a);
    *acceleration = a;
    return status;
}

static void destroy_level(struct acceleration *a, struct level *level)
{
    if (level->handle != VK_NULL_HANDLE && gpu_settle(a->gpu))
        a->calls.destroy(gpu_vk_device(a->gpu), level->handle, NULL);
    gpu_buffer_destroy(a->gpu, &level->memory);
}

void acceleration_destroy(struct acceleration **acceleration)
{
    struct acceleration *a = *acceleration;
    if (a == NULL)
        return;
    destroy_level(a, &a->top);
    destroy_level(a, &a->bottom);
    kiln_free(acceleration);
}

uint64_t acceleration_address(const struct acceleration *acceleration) { return acceleration->top.address; }
