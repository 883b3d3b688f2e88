#include <assert.h>
#include <string.h>

#include "shaders/shared/fold.h"
#include "worker/backend/vulkan/gpu/private.h"
#include "worker/base/clock.h"
#include "worker/base/memory.h"

enum { MOST_CONSTANTS = 32, WORKGROUP = 64 };

enum { GROUPS = 3 }; /* of a ray-tracing kernel's stages: ray generation, miss, hit */

#define TRACING_STAGES                                                                                                 \
    (VK_SHADER_STAGE_RAYGEN_BIT_KHR | VK_SHADER_STAGE_MISS_BIT_KHR | VK_SHADER_STAGE_CLOSEST_HIT_BIT_KHR |             \
     VK_SHADER_STAGE_ANY_HIT_BIT_KHR)

struct gpu_kernel {
    const char *name;
    uint32_t constant; /* the last */
    bool tracing;
    VkPipeline pipeline;
    struct gpu_buffer table; /* shader binding table: one record a group */
    VkStridedDeviceAddressRegionKHR regions[GROUPS];
};

static VkResult create_layout(struct gpu *gpu, VkShaderStageFlags stages, VkPipelineLayout *layout)
{
    const VkPushConstantRange range = {.stageFlags = stages, .offset = 0, .size = GPU_PUSH_BYTES};
    const VkPipelineLayoutCreateInfo info = {.sType = VK_STRUCTURE_TYPE_PIPELINE_LAYOUT_CREATE_INFO,
                                             .pushConstantRangeCount = 1,
                                             .pPushConstantRanges = &range};
    return GPU_TRY(gpu, vkCreatePipelineLayout(gpu->device, &info, NULL, layout));
}

int gpu_layouts_create(struct gpu *gpu, struct kiln_error *error)
{
    VkResult result = create_layout(gpu, VK_SHADER_STAGE_COMPUTE_BIT, &gpu->compute_layout);
    if (result == VK_SUCCESS && gpu->about.ray_tracing)
        result = create_layout(gpu, TRACING_STAGES, &gpu->tracing_layout);
    return result == VK_SUCCESS ? KILN_OK : gpu_failure(gpu, result, error, "cannot create the layout of kernels");
}

void gpu_layouts_destroy(struct gpu *gpu)
{
    vkDestroyPipelineLayout(gpu->device, gpu->compute_layout, NULL);
    vkDestroyPipelineLayout(gpu->device, gpu->tracing_layout, NULL);
}

/* ---- making kernels ---- */

static VkResult create_module(struct gpu *gpu, const struct gpu_words *code, VkShaderModule *module)
{
    const VkShaderModuleCreateInfo info = {
        .sType = VK_STRUCTURE_TYPE_SHADER_MODULE_CREATE_INFO, .codeSize = code->bytes, .pCode = code->words};
    return GPU_TRY(gpu, vkCreateShaderModule(gpu->device, &info, NULL, module));
}

static VkPipelineShaderStageCreateInfo stage_info(VkShaderStageFlagBits stage, VkShaderModule module,
                                                  const VkSpecializationInfo *constants)
{
    return (VkPipelineShaderStageCreateInfo){.sType = VK_STRUCTURE_TYPE_PIPELINE_SHADER_STAGE_CREATE_INFO,
                                             .stage = stage,
                                             .module = module,
                                             .pName = "main",
                                             .pSpecializationInfo = constants};
}

static int create_compute(struct gpu *gpu, struct gpu_kernel *k, const struct gpu_kernel_params *params,
                          const struct gpu_words words[GPU_STAGES], const VkSpecializationInfo *constants,
                          struct kiln_error *error)
{
    VkShaderModule module = VK_NULL_HANDLE;
    struct gpu_kept kept;
    VkResult result = create_module(gpu, &words[GPU_STAGE_MAIN], &module);
    const VkComputePipelineCreateInfo info = {.sType = VK_STRUCTURE_TYPE_COMPUTE_PIPELINE_CREATE_INFO,
                                              .stage = stage_info(VK_SHADER_STAGE_COMPUTE_BIT, module, constants),
                                              .layout = gpu->compute_layout};
    gpu_kept_open(gpu, params, words, &kept);
    if (result == VK_SUCCESS)
        result = GPU_TRY(gpu, vkCreateComputePipelines(gpu->device, kept.cache, 1, &info, NULL, &k->pipeline));
    gpu_kept_close(gpu, &kept, result == VK_SUCCESS);
    vkDestroyShaderModule(gpu->device, module, NULL);
    return result == VK_SUCCESS ? KILN_OK
                                : gpu_failure(gpu, result, error, "cannot make the kernel '%s'", params->name);
}

static VkRayTracingShaderGroupCreateInfoKHR general_group(uint32_t stage)
{
    return (VkRayTracingShaderGroupCreateInfoKHR){.sType = VK_STRUCTURE_TYPE_RAY_TRACING_SHADER_GROUP_CREATE_INFO_KHR,
                                                  .type = VK_RAY_TRACING_SHADER_GROUP_TYPE_GENERAL_KHR,
                                                  .generalShader = stage,
                                                  .closestHitShader = VK_SHADER_UNUSED_KHR,
                                                  .anyHitShader = VK_SHADER_UNUSED_KHR,
                                                  .intersectionShader = VK_SHADER_UNUSED_KHR};
}

static VkResult create_tracing_pipeline(struct gpu *gpu, struct gpu_kernel *k, VkPipelineCache cache,
                                        const VkPipelineShaderStageCreateInfo *stages, uint32_t count,
                                        uint32_t closest_hit, uint32_t any_hit)
{
    const VkRayTracingShaderGroupCreateInfoKHR groups[GROUPS] = {
        general_group(GPU_STAGE_MAIN),
        general_group(GPU_STAGE_MISS),
        {.sType = VK_STRUCTURE_TYPE_RAY_TRACING_SHADER_GROUP_CREATE_INFO_KHR,
         .type = VK_RAY_TRACING_SHADER_GROUP_TYPE_TRIANGLES_HIT_GROUP_KHR,
         .generalShader = VK_SHADER_UNUSED_KHR,
         .closestHitShader = closest_hit,
         .anyHitShader = any_hit,
         .intersectionShader = VK_SHADER_UNUSED_KHR}};
    const VkRayTracingPipelineCreateInfoKHR info = {.sType = VK_STRUCTURE_TYPE_RAY_TRACING_PIPELINE_CREATE_INFO_KHR,
                                                    .stageCount = count,
                                                    .pStages = stages,
                                                    .groupCount = GROUPS,
                                                    .pGroups = groups,
                                                    .maxPipelineRayRecursionDepth = 1,
                                                    .layout = gpu->tracing_layout};
    return GPU_TRY(gpu,
                   gpu->extensions.create_pipelines(gpu->device, VK_NULL_HANDLE, cache, 1, &info, NULL, &k->pipeline));
}

/* Makes the shader binding table: one record per group, each at a multiple of the base alignment. */
static int create_table(struct gpu *gpu, struct gpu_kernel *k, struct kiln_error *error)
{
    enum { MOST_BYTES = 1024 };
    char handles[MOST_BYTES], table[MOST_BYTES] = {0};
    const size_t handle = gpu->ray_tracing.shaderGroupHandleSize, base = gpu->ray_tracing.shaderGroupBaseAlignment;
    const size_t stride = (handle + base - 1) / base * base;
    if (GROUPS * stride > MOST_BYTES)
        return kiln_fail(error, KILN_NO_DEVICE, "%s has shader groups of %zu bytes; kiln is made for %d at most",
                         gpu->about.name, stride, MOST_BYTES / GROUPS);
    const VkResult result =
        GPU_TRY(gpu, gpu->extensions.group_handles(gpu->device, k->pipeline, 0, GROUPS, GROUPS * handle, handles));
    if (result != VK_SUCCESS)
        return gpu_failure(gpu, result, error, "cannot get the shaders of the kernel '%s'", k->name);
    for (size_t i = 0; i < GROUPS; i++)
        memcpy(table + i * stride, handles + i * handle, handle);
    const int status = gpu_buffer_of(gpu, &k->table, table, GROUPS * stride, "a kernel's table of shaders", error);
    for (size_t i = 0; i < GROUPS; i++)
        k->regions[i] = (VkStridedDeviceAddressRegionKHR){
            .deviceAddress = k->table.address + i * stride, .stride = stride, .size = stride};
    return status;
}

static int create_tracing(struct gpu *gpu, struct gpu_kernel *k, const struct gpu_kernel_params *params,
                          const struct gpu_words words[GPU_STAGES], const VkSpecializationInfo *constants,
                          struct kiln_error *error)
{
    static const VkShaderStageFlagBits kinds[GPU_STAGES] = {[GPU_STAGE_MAIN] = VK_SHADER_STAGE_RAYGEN_BIT_KHR,
                                                            [GPU_STAGE_MISS] = VK_SHADER_STAGE_MISS_BIT_KHR,
                                                            [GPU_STAGE_CLOSEST_HIT] =
                                                                VK_SHADER_STAGE_CLOSEST_HIT_BIT_KHR,
                                                            [GPU_STAGE_ANY_HIT] = VK_SHADER_STAGE_ANY_HIT_BIT_KHR};
    VkShaderModule modules[GPU_STAGES] = {VK_NULL_HANDLE};
    VkPipelineShaderStageCreateInfo stages[GPU_STAGES];
    uint32_t count = 0, places[GPU_STAGES];
    struct gpu_kept kept;
    VkResult result = VK_SUCCESS;
    if (!gpu->about.ray_tracing)
        return kiln_fail(error, KILN_NO_DEVICE,
                         "%s has no ray-tracing pipeline, which the kernel '%s' needs; set KILN_TRAVERSAL=compute",
                         gpu->about.name, params->name);
    for (uint32_t i = 0; i < GPU_STAGES && result == VK_SUCCESS; i++) {
        places[i] = VK_SHADER_UNUSED_KHR;
        if (words[i].words == NULL)
            continue;
        result = create_module(gpu, &words[i], &modules[i]);
        places[i] = count;
        stages[count++] = stage_info(kinds[i], modules[i], constants);
    }
    gpu_kept_open(gpu, params, words, &kept);
    if (result == VK_SUCCESS)
        result = create_tracing_pipeline(gpu, k, kept.cache, stages, count, places[GPU_STAGE_CLOSEST_HIT],
                                         places[GPU_STAGE_ANY_HIT]);
    gpu_kept_close(gpu, &kept, result == VK_SUCCESS);
    for (uint32_t i = 0; i < GPU_STAGES; i++)
        vkDestroyShaderModule(gpu->device, modules[i], NULL);
    if (result != VK_SUCCESS)
        return gpu_failure(gpu, result, error, "cannot make the ray-tracing kernel '%s'", params->name);
    return create_table(gpu, k, error);
}

/* Unpacks the code of all stages; free each with kiln_free. */
static int unpack_all(const struct gpu *gpu, const struct gpu_kernel_params *params, struct gpu_words words[GPU_STAGES],
                      struct kiln_error *error)
{
    const struct gpu_hit_shaders none = {0}, *h = params->hit_shaders != NULL ? params->hit_shaders : &none;
    const struct gpu_code *codes[GPU_STAGES] = {[GPU_STAGE_MAIN] = params->code,
                                                [GPU_STAGE_MISS] = h->miss,
                                                [GPU_STAGE_CLOSEST_HIT] = h->closest_hit,
                                                [GPU_STAGE_ANY_HIT] = h->any_hit};
    int status = KILN_OK;
    for (uint32_t i = 0; i < GPU_STAGES && status == KILN_OK; i++)
        status = codes[i] != NULL ? gpu_code_unpack(gpu, codes[i], &words[i], error) : KILN_OK;
    return status;
}

int gpu_kernel_create(struct gpu *gpu, struct gpu_kernel **kernel, const struct gpu_kernel_params *params,
                      struct kiln_error *error)
{
    VkSpecializationMapEntry entries[MOST_CONSTANTS];
    struct gpu_words words[GPU_STAGES] = {{NULL, 0}};
    assert(params->constant_count <= MOST_CONSTANTS);
    for (uint32_t i = 0; i < params->constant_count; i++)
        entries[i] = (VkSpecializationMapEntry){
            .constantID = i, .offset = i * (uint32_t)sizeof(uint32_t), .size = sizeof(uint32_t)};
    const VkSpecializationInfo constants = {.mapEntryCount = (uint32_t)params->constant_count,
                                            .pMapEntries = entries,
                                            .dataSize = params->constant_count * sizeof(uint32_t),
                                            .pData = params->constants};
    const double begin = kiln_clock_seconds();
    int status = kiln_allocate(kernel, 1, sizeof **kernel, params->name, error);
    if (status != KILN_OK)
        return status;
    (*kernel)->name = params->name;
    (*kernel)->constant = params->constant_count > 0 ? params->constants[params->constant_count - 1] : 0;
    (*kernel)->tracing = params->hit_shaders != NULL;
    status = unpack_all(gpu, params, words, error);
    if (status == KILN_OK)
        status = ((*kernel)->tracing ? create_tracing : create_compute)(gpu, *kernel, params, words, &constants, error);
    for (uint32_t i = 0; i < GPU_STAGES; i++)
        kiln_free(&words[i].words);
    if (status == KILN_OK)
        gpu_name(gpu, VK_OBJECT_TYPE_PIPELINE, (uint64_t)(*kernel)->pipeline, params->name);
    else
        gpu_kernel_destroy(gpu, kernel);
    if (gpu->times != NULL && status == KILN_OK)
        gpu_times_make(gpu, params->name, (*kernel)->constant, kiln_clock_seconds() - begin);
    return status;
}

void gpu_kernel_destroy(struct gpu *gpu, struct gpu_kernel **kernel)
{
    if (*kernel == NULL)
        return;
    gpu_buffer_destroy(gpu, &(*kernel)->table);
    if (gpu_settle(gpu))
        vkDestroyPipeline(gpu->device, (*kernel)->pipeline, NULL);
    kiln_free(kernel);
}

const char *gpu_kernel_name(const struct gpu_kernel *kernel) { return kernel->name; }

uint32_t gpu_kernel_constant(const struct gpu_kernel *kernel) { return kernel->constant; }

/* ---- starting them ---- */

struct dispatch {
    uint32_t x, y, z; /* workgroups */
};

static uint32_t divide_up(uint32_t a, uint32_t b) { return a / b + (a % b != 0 ? 1 : 0); }

/* Folds a dimension that is too large into z; shaders/main.glsl unfolds it. False: both are too large. */
static bool fold(const struct gpu_step *step, const uint32_t limit[3], struct dispatch *d)
{
    *d = (struct dispatch){.x = divide_up(step->threads_x, WORKGROUP), .y = step->threads_y, .z = 1};
    if (d->y > limit[1]) {
        d->z = divide_up(d->y, KILN_FOLD_Y);
        d->y = KILN_FOLD_Y;
        return d->x <= limit[0] && d->z <= limit[2];
    }
    if (d->x > limit[0]) {
        d->z = divide_up(d->x, limit[0]);
        d->x = divide_up(d->x, d->z);
        d->y += d->y == KILN_FOLD_Y ? 1 : 0; /* exactly KILN_FOLD_Y would mean that y is folded */
    }
    return d->z <= limit[2];
}

int gpu_kernel_fits(const struct gpu_kernel *kernel, const struct gpu_step *step, const struct gpu *gpu,
                    struct kiln_error *error)
{
    struct dispatch d;
    const uint64_t threads = (uint64_t)step->threads_x * step->threads_y;
    if (kernel->tracing ? threads <= gpu->ray_tracing.maxRayDispatchInvocationCount
                        : fold(step, gpu->limits.maxComputeWorkGroupCount, &d))
        return KILN_OK;
    return kiln_fail(error, KILN_BUG, "%s cannot start %u x %u threads of the kernel '%s' at once", gpu->about.name,
                     step->threads_x, step->threads_y, kernel->name);
}

void gpu_kernel_record(const struct gpu_kernel *kernel, VkCommandBuffer commands, const struct gpu_step *step,
                       const struct gpu *gpu)
{
    struct dispatch d;
    const VkPipelineLayout layout = kernel->tracing ? gpu->tracing_layout : gpu->compute_layout;
    assert(step->constant_bytes <= GPU_PUSH_BYTES && step->constant_bytes % 4 == 0);
    gpu_guard_mark(gpu, commands, kernel->name);
    vkCmdBindPipeline(commands,
                      kernel->tracing ? VK_PIPELINE_BIND_POINT_RAY_TRACING_KHR : VK_PIPELINE_BIND_POINT_COMPUTE,
                      kernel->pipeline);
    if (step->constant_bytes > 0)
        vkCmdPushConstants(commands, layout, kernel->tracing ? TRACING_STAGES : VK_SHADER_STAGE_COMPUTE_BIT, 0,
                           (uint32_t)step->constant_bytes, step->constants);
    if (kernel->tracing) {
        const VkStridedDeviceAddressRegionKHR none = {0};
        gpu->extensions.trace_rays(commands, &kernel->regions[0], &kernel->regions[1], &kernel->regions[2], &none,
                                   step->threads_x, step->threads_y, 1);
    } else if (fold(step, gpu->limits.maxComputeWorkGroupCount, &d)) {
        vkCmdDispatch(commands, d.x, d.y, d.z);
    }
}
