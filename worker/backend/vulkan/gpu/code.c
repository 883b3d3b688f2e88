#include "worker/backend/vulkan/gpu/code.h"

#include <string.h>

#include <xxhash.h>
#include <zstd.h>

#include "worker/backend/vulkan/gpu/private.h"
#include "worker/base/memory.h"

int gpu_code_read(struct gpu *gpu, const struct gpu_code_file *of, struct kiln_error *error)
{
    enum { MOST = 64 << 20 }; /* bytes of a file of another build */
    size_t size = 0;
    kiln_free(&gpu->code_file);
    if (gpu->kernels.file == NULL)
        return kiln_fail(error, KILN_NO_DEVICE, "%s has no doubles, and nothing reads the file " GPU_CODE_FILE " here",
                         gpu->about.name);
    const int status = gpu->kernels.file(GPU_CODE_FILE, MOST, &gpu->code_file, &size, error);
    if (status != KILN_OK)
        return status;
    const XXH128_hash_t hash = XXH3_128bits(gpu->code_file, size);
    if (size == of->bytes && hash.low64 == of->low && hash.high64 == of->high)
        return KILN_OK;
    kiln_free(&gpu->code_file);
    return kiln_fail(error, KILN_NO_DEVICE,
                     "%s has no doubles, and " GPU_CODE_FILE ", whose kernels it needs, is not of this build of kiln: "
                     "install both from one build, or use --backend embree",
                     gpu->about.name);
}

int gpu_code_unpack(const struct gpu *gpu, const struct gpu_code *code, struct gpu_words *words,
                    struct kiln_error *error)
{
    const void *packed = code->packed;
    if (packed == NULL && gpu->code_file == NULL)
        return kiln_fail(error, KILN_BUG, "a kernel without doubles is asked for, and " GPU_CODE_FILE " was not read");
    if (packed == NULL)
        packed = gpu->code_file + code->place;
    const int status = kiln_allocate(&words->words, code->bytes, 1, "a kernel's code", error);
    if (status != KILN_OK)
        return status;
    words->bytes = ZSTD_decompress(words->words, code->bytes, packed, code->packed_bytes);
    if (words->bytes == code->bytes)
        return KILN_OK;
    kiln_free(&words->words);
    return kiln_fail(error, KILN_BUG, "a kernel's code of %zu bytes cannot be decompressed", code->bytes);
}
