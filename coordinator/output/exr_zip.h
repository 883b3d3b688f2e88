/* ZIP compression of OpenEXR chunks by libdeflate, in a third of the time of zlib, which the OpenEXR library uses. The
 * format is the same (OpenEXR, Technical Introduction, "ZIP"): the bytes at even places of a chunk, then those at odd
 * ones, each replaced by its difference from the one before, as a zlib stream. Private to coordinator/output; not
 * collective. */
#ifndef KILN_COORDINATOR_OUTPUT_EXR_ZIP_H
#define KILN_COORDINATOR_OUTPUT_EXR_ZIP_H

#include <openexr.h>

/* State of one pipeline, for one chunk at a time. Create with exr_zip_create, which returns NULL if memory is short;
 * destroy takes the address, sets NULL and accepts NULL. */
struct exr_zip;
struct exr_zip *exr_zip_create(void);
void exr_zip_destroy(struct exr_zip **zip);

/* Makes an initialised pipeline use `zip`, which it borrows until it is destroyed. The encoder's file must have ZIP
 * compression; a decoder is left as it is unless its file has ZIP or ZIPS. The compressed bytes of a chunk depend on
 * the chunk only. An incompressible chunk is stored uncompressed: readers recognize it by its size. A damaged chunk is
 * EXR_ERR_CORRUPT_CHUNK. */
void exr_zip_encode(struct exr_zip *zip, exr_encode_pipeline_t *encoder);
void exr_zip_decode(struct exr_zip *zip, exr_decode_pipeline_t *decoder);

#endif
