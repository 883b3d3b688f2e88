/* What the sources of OpenEXR files share; for nobody else. */
#ifndef KILN_COORDINATOR_OUTPUT_EXR_PRIVATE_H
#define KILN_COORDINATOR_OUTPUT_EXR_PRIVATE_H

#include <openexr.h>

#include "coordinator/output/exr.h"

/* The library would print to stderr; what it says becomes our sentence instead. */
void exr_stay_silent(exr_const_context_t context, exr_result_t code, const char *message);

/* The sentence "'PATH' cannot be ACT as OpenEXR: ..."; KILN_SYSTEM where memory is what was missing, else `status`. */
int exr_failed(int status, const char *path, const char *act, exr_result_t code, struct kiln_error *error);

/* Where the library's bytes go: the descriptor. The first failure is kept in `status`, its sentence in `error`. */
struct exr_output_stream {
    int descriptor;
    const char *path;
    struct kiln_error *error;
    int status;
};
int64_t exr_write_stream(exr_const_context_t context, void *user, const void *buffer, uint64_t size, uint64_t offset,
                         exr_stream_error_func_ptr_t report);

/* Describes the image to a file that was just started, and writes the header. */
exr_result_t exr_declare(exr_context_t file, const struct kiln_image *image,
                         const struct kiln_exr_attribute *attributes, size_t attribute_count);

/* Packs one chunk after another; `write` is the library's writing of it, for when its turn has come. Begin with
 * EXR_PACKER, end with exr_encoding_destroy. The packed bytes are in the encoder's compressed_buffer. */
struct exr_packer {
    exr_encode_pipeline_t encoder;
    exr_result_t (*write)(exr_encode_pipeline_t *encoder);
    exr_result_t code;
    bool started;
};
#define EXR_PACKER ((struct exr_packer){.encoder = EXR_ENCODE_PIPELINE_INITIALIZER})
exr_result_t exr_pack_chunk(struct exr_packer *packer, exr_context_t file, const struct kiln_image *image, uint32_t y);

/* KILN_CANNOT_CREATE where OpenEXR has no such size, KILN_BUG where a value does not fit its half. */
int exr_check_image(const char *path, const struct kiln_image *image, struct kiln_error *error);

/* Unpacks all chunks, the first of which begins at row `top`, into the image's channels; its threads share them. */
exr_result_t exr_read_chunks(exr_const_context_t file, int32_t top, const struct kiln_image *image);

/* How many of `count` values from the first one on read back as what was given to be written. */
size_t exr_count_same(const struct kiln_image_channel *given, const struct kiln_image_channel *found, size_t count);

#endif
