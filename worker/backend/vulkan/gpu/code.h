/* Kernels' SPIR-V as kiln comes with it: modules compressed by zstd, in the program or in a file beside it.
 * shaders/compile/main.cpp makes them when kiln is built, and "shaders/modules.h" names each kiln_code_NAME. */
#ifndef KILN_WORKER_BACKEND_VULKAN_GPU_CODE_H
#define KILN_WORKER_BACKEND_VULKAN_GPU_CODE_H

#include <stddef.h>
#include <stdint.h>

struct gpu_code {
    const unsigned char *packed; /* NULL: in the file, from byte `place` on */
    size_t place, packed_bytes;
    size_t bytes;   /* of the words */
    uint32_t asked; /* bit i: the code asks for its specialisation constant i, and does not only declare it */
};

/* The file of modules of devices without doubles: its name, its size, and XXH3 of it, low and high half. */
#define GPU_CODE_FILE "kiln-float.kernels"
struct gpu_code_file {
    size_t bytes;
    uint64_t low, high;
};
extern const struct gpu_code_file kiln_code_file;

#endif
