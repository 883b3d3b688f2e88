/* Vulkan calls that can fail: error messages, and injected faults for tests. */
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "worker/backend/vulkan/gpu/private.h"

static bool fault_is_due(struct gpu_faults *f)
{
    if (f == NULL || f->wanted.kind == KILN_DEVICE_FAULT_NONE)
        return false;
    const uint64_t call = ++f->calls, at = f->wanted.at, every = f->wanted.every;
    return call == at || (every != 0 && call > at && (call - at) % every == 0);
}

bool gpu_refuses(struct gpu *gpu)
{
    if (!gpu->lost && !fault_is_due(gpu->faults))
        return false;
    gpu->refusal = gpu->lost || gpu->faults->wanted.kind == KILN_DEVICE_FAULT_LOST ? VK_ERROR_DEVICE_LOST
                                                                                   : VK_ERROR_OUT_OF_DEVICE_MEMORY;
    return true;
}

VkResult gpu_outcome(struct gpu *gpu, VkResult result)
{
    if (result < 0)
        gpu->short_of_memory = result == VK_ERROR_OUT_OF_DEVICE_MEMORY;
    if (result == VK_ERROR_DEVICE_LOST)
        gpu->lost = true;
    return result;
}

bool gpu_lost(const struct gpu *gpu) { return gpu->lost; }

bool gpu_short_of_memory(const struct gpu *gpu) { return !gpu->lost && gpu->short_of_memory; }

static const char *meaning(VkResult result)
{
    switch (result) {
    case VK_ERROR_DEVICE_LOST:
        return "the device was lost; the system's log (dmesg) may say why";
    case VK_ERROR_OUT_OF_DEVICE_MEMORY:
        return "the device has too little free memory";
    case VK_ERROR_OUT_OF_HOST_MEMORY:
        return "out of memory";
    case VK_ERROR_INITIALIZATION_FAILED:
        return "the driver does not start";
    case VK_ERROR_FEATURE_NOT_PRESENT:
        return "the driver lacks a feature that it offers";
    case VK_ERROR_EXTENSION_NOT_PRESENT:
        return "the driver lacks an extension that it offers";
    case VK_ERROR_TOO_MANY_OBJECTS:
        return "the driver takes no more objects of this kind";
    case VK_TIMEOUT:
        return "the device does not answer";
    default:
        return "the driver refused";
    }
}

int gpu_failure(const struct gpu *gpu, VkResult result, struct kiln_error *error, const char *format, ...)
{
    char sentence[1024];
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(sentence, sizeof sentence, format, arguments);
    va_end(arguments);
    const char *device = gpu != NULL && gpu->about.name[0] != '\0' ? gpu->about.name : "Vulkan";
    return kiln_fail(error, result == VK_ERROR_OUT_OF_HOST_MEMORY ? KILN_SYSTEM : KILN_NO_DEVICE,
                     "%s: %s: %s (VkResult %d)", device, sentence, meaning(result), (int)result);
}
