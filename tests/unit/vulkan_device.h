/* The Vulkan device for tests of kernels: any device, also a software one. Include after cmocka.h. */
#ifndef KILN_TESTS_UNIT_VULKAN_DEVICE_H
#define KILN_TESTS_UNIT_VULKAN_DEVICE_H

#include <string.h>

#include "worker/backend/backend.h"
#include "worker/backend/vulkan/gpu/gpu.h"

/* False, with a message, if there is no device; the program must then end with 77. */
static inline bool vulkan_device_is_there(void)
{
    size_t count = 0;
    if (gpu_list(NULL, 0, &count, NULL) == KILN_OK && count > 0)
        return true;
    print_message("skipped: there is no Vulkan device here\n");
    return false;
}

/* For cmocka_run_group_tests: *state is a struct gpu. */
static inline int vulkan_device_open(void **state)
{
    struct gpu *gpu = NULL;
    struct kiln_error error = {""};
    if (gpu_create(&gpu, &(struct gpu_choice){.device = -1}, &error) != KILN_OK) {
        print_error("%s\n", error.message);
        return -1;
    }
    *state = gpu;
    return 0;
}

static inline int vulkan_device_close(void **state)
{
    struct gpu *gpu = *state;
    gpu_destroy(&gpu);
    return 0;
}

/* Fails where the backend has not run the kernel of that name. */
static inline void vulkan_has_run(const struct kiln_backend *backend, const char *kernel)
{
    struct kiln_backend_info info;
    kiln_backend_info(backend, &info);
    for (size_t i = 0; i < info.kernel_count; i++)
        if (strcmp(info.kernels[i], kernel) == 0)
            return;
    fail_msg("the kernel '%s' has not run", kernel);
}

#endif
