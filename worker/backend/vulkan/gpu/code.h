/* Kernels' SPIR-V as kiln comes with it: modules compressed by zstd, in the program or in a file beside it.
 * shaders/compile/main.cpp makes them when kiln is built, and "shaders/modules.h" names each kiln_code_NAME. */
#ifndef KILN_WORKER_BACKEND_VULKAN_GPU_CODE_H
#define KILN_WORKER_BACKEND_VULKAN_GPU_CODE_H

#include <stddef.h>
#include <stdint.h>

struct gpu_code {
    const unsigned char *packed; /* compressed module; NULL: it is in the file, from byte `place` on */
    size_t place, packed_bytes;
    size_t bytes;   /* size of the SPIR-V words, bytes */
    uint32_t asked; /* bit i: the code uses specialisation constant i, and does not only declare it */
};

/* File of modules for devices without doubles: its name, its size, and its XXH3 hash, low and high half. */
#define GPU_CODE_FILE "kiln-float.kernels"
struct gpu_code_file {
    size_t bytes;
    uint64_t low, high;
};
extern const struct gpu_code_file kiln_code_file;

#endif
