#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "worker/backend/vulkan/gpu/private.h"

#define VALIDATION_LAYER "VK_LAYER_KHRONOS_validation"

enum { MESSAGES_SHOWN = 20 };

static VKAPI_ATTR VkBool32 VKAPI_CALL take_message(VkDebugUtilsMessageSeverityFlagBitsEXT severity,
                                                   VkDebugUtilsMessageTypeFlagsEXT types,
                                                   const VkDebugUtilsMessengerCallbackDataEXT *data, void *context)
{
    (void)severity;
    (void)types;
    struct gpu *gpu = context;
    if (atomic_fetch_add(&gpu->messages, 1) < MESSAGES_SHOWN)
        (void)fprintf(stderr, "kiln: Vulkan validation: %s\n", data->pMessage);
    return VK_FALSE;
}

static VkDebugUtilsMessengerCreateInfoEXT messenger_info(struct gpu *gpu)
{
    return (VkDebugUtilsMessengerCreateInfoEXT){
        .sType = VK_STRUCTURE_TYPE_DEBUG_UTILS_MESSENGER_CREATE_INFO_EXT,
        .messageSeverity =
            VK_DEBUG_UTILS_MESSAGE_SEVERITY_WARNING_BIT_EXT | VK_DEBUG_UTILS_MESSAGE_SEVERITY_ERROR_BIT_EXT,
        .messageType = VK_DEBUG_UTILS_MESSAGE_TYPE_GENERAL_BIT_EXT | VK_DEBUG_UTILS_MESSAGE_TYPE_VALIDATION_BIT_EXT,
        .pfnUserCallback = take_message,
        .pUserData = gpu,
    };
}

static bool has_validation_layer(void)
{
    VkLayerProperties layers[64];
    uint32_t count = sizeof layers / sizeof *layers;
    const VkResult result = vkEnumerateInstanceLayerProperties(&count, layers);
    for (uint32_t i = 0; (result == VK_SUCCESS || result == VK_INCOMPLETE) && i < count; i++)
        if (strcmp(layers[i].layerName, VALIDATION_LAYER) == 0)
            return true;
    return false;
}

static void create_messenger(struct gpu *gpu, VkInstance instance, const VkDebugUtilsMessengerCreateInfoEXT *info)
{
    const PFN_vkCreateDebugUtilsMessengerEXT create =
        (PFN_vkCreateDebugUtilsMessengerEXT)vkGetInstanceProcAddr(instance, "vkCreateDebugUtilsMessengerEXT");
    gpu->extensions.set_name =
        (PFN_vkSetDebugUtilsObjectNameEXT)vkGetInstanceProcAddr(instance, "vkSetDebugUtilsObjectNameEXT");
    if (create == NULL || create(instance, info, NULL, &gpu->messenger) != VK_SUCCESS)
        gpu->messenger = VK_NULL_HANDLE; /* the layer then prints by itself */
}

int gpu_instance_create(struct gpu *gpu, bool validation, VkInstance *instance, struct kiln_error *error)
{
    const char *wish = getenv("KILN_VULKAN_VALIDATION");
    const bool inside = gpu != NULL && wish != NULL && strcmp(wish, "gpu") == 0;
    const bool checked = gpu != NULL && (validation || inside || (wish != NULL && strcmp(wish, "1") == 0));
    if (checked && !has_validation_layer())
        return kiln_fail(
            error, KILN_NO_DEVICE,
            "validation was asked for, and the layer %s is not installed (Debian: vulkan-validationlayers)",
            VALIDATION_LAYER);
    static const char *const layers[] = {VALIDATION_LAYER}, *const extensions[] = {VK_EXT_DEBUG_UTILS_EXTENSION_NAME};
    static const VkValidationFeatureEnableEXT enabled[] = {
        VK_VALIDATION_FEATURE_ENABLE_GPU_ASSISTED_EXT,
        VK_VALIDATION_FEATURE_ENABLE_GPU_ASSISTED_RESERVE_BINDING_SLOT_EXT};
    VkDebugUtilsMessengerCreateInfoEXT messenger = messenger_info(gpu);
    const VkValidationFeaturesEXT features = {.sType = VK_STRUCTURE_TYPE_VALIDATION_FEATURES_EXT,
                                              .pNext = &messenger,
                                              .enabledValidationFeatureCount = 2,
                                              .pEnabledValidationFeatures = enabled};
    const VkApplicationInfo application = {
        .sType = VK_STRUCTURE_TYPE_APPLICATION_INFO, .pApplicationName = "kiln", .apiVersion = VK_API_VERSION_1_2};
    const VkInstanceCreateInfo info = {
        .sType = VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO,
        .pNext = !checked ? NULL
                 : inside ? (const void *)&features
                          : (const void *)&messenger,
        .pApplicationInfo = &application,
        .enabledLayerCount = checked ? 1 : 0,
        .ppEnabledLayerNames = layers,
        .enabledExtensionCount = checked ? 1 : 0,
        .ppEnabledExtensionNames = extensions,
    };
    *instance = VK_NULL_HANDLE;
    const VkResult result =
        gpu != NULL ? GPU_TRY(gpu, vkCreateInstance(&info, NULL, instance)) : vkCreateInstance(&info, NULL, instance);
    if (result == VK_ERROR_INCOMPATIBLE_DRIVER) /* the loader reports this if no driver is installed */
        return KILN_OK;
    if (result != VK_SUCCESS)
        return gpu_failure(gpu, result, error, "Vulkan does not start");
    if (checked)
        create_messenger(gpu, *instance, &messenger);
    return KILN_OK;
}
