/* Private parts of OpenEXR files: shared by exr.c and exr_strips.c. */
#ifndef KILN_COORDINATOR_OUTPUT_EXR_PRIVATE_H
#define KILN_COORDINATOR_OUTPUT_EXR_PRIVATE_H

#include <openexr.h>

#include "coordinator/output/exr.h"
#include "coordinator/output/exr_zip.h"

/* Error handler of the library that prints nothing; our messages are made from the error codes. */
void exr_stay_silent(exr_const_context_t context, exr_result_t code, const char *message);

/* Sets the message "'PATH' cannot be ACT as OpenEXR: ..."; returns KILN_SYSTEM if memory was short, else `status`. */
int exr_failed(int status, const char *path, const char *act, exr_result_t code, struct kiln_error *error);

/* Output stream of the library: writes to the descriptor. The first failure is kept in `status`, its message in
 * `error`. */
struct exr_output_stream {
    int descriptor;
    const char *path;
    struct kiln_error *error;
    int status;
};
int64_t exr_write_stream(exr_const_context_t context, void *user, const void *buffer, uint64_t size, uint64_t offset,
                         exr_stream_error_func_ptr_t report);

/* Declares channels and attributes of the image in a file that was just started, and writes the header. */
exr_result_t exr_declare(exr_context_t file, const struct kiln_image *image,
                         const struct kiln_exr_attribute *attributes, size_t attribute_count);

/* Makes the header bytes of a file with the image's channels and `height` rows, up to its table of chunks, which begins
 * at `size`. *header is allocated. */
int exr_make_header(const char *path, const struct kiln_image *image, uint32_t height,
                    const struct kiln_exr_attribute *attributes, size_t attribute_count, uint8_t **header, size_t *size,
                    struct kiln_error *error);

/* A packer compresses one chunk at a time. `write` is the library's function that writes the chunk, to be called when
 * its turn has come. Initialise with EXR_PACKER, end with exr_packer_end. The compressed bytes are in the encoder's
 * compressed_buffer. */
struct exr_packer {
    exr_encode_pipeline_t encoder;
    struct exr_zip *zip;
    exr_result_t (*write)(exr_encode_pipeline_t *encoder);
    exr_result_t code;
    bool started;
};
#define EXR_PACKER ((struct exr_packer){.encoder = EXR_ENCODE_PIPELINE_INITIALIZER})
exr_result_t exr_pack_chunk(struct exr_packer *packer, exr_context_t file, const struct kiln_image *image, uint32_t y);
exr_result_t exr_packer_end(struct exr_packer *packer, exr_const_context_t file);

/* KILN_CANNOT_CREATE if OpenEXR does not support the size, KILN_BUG if a value does not fit a half. */
int exr_check_image(const char *path, const struct kiln_image *image, struct kiln_error *error);

/* Decompresses all chunks, the first of which begins at row `top`, into the channels of the image, with all threads. */
exr_result_t exr_read_chunks(exr_const_context_t file, int32_t top, const struct kiln_image *image);

/* Returns the number of equal values, of `count` from the first one on, before the first difference. */
size_t exr_count_same(const struct kiln_image_channel *given, const struct kiln_image_channel *found, size_t count);

#endif
