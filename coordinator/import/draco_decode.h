/* C interface to the Draco decoder (KHR_draco_mesh_compression). The library has no C interface, so draco_decode.cpp is
 * kiln's one C++ file. No exception leaves it. Nothing here is collective; a mesh is used by one thread at a time.
 *
 * The library is not made for hostile input: it may allocate memory for sizes that the data merely claims. It is called
 * only in the confined child, whose limits bound it. */
#ifndef KILN_COORDINATOR_IMPORT_DRACO_DECODE_H
#define KILN_COORDINATOR_IMPORT_DRACO_DECODE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct kiln_draco;

/* Decodes a triangle mesh. Returns NULL, and why in `reason`, when the data is not one. Destroy with
 * kiln_draco_destroy. */
struct kiln_draco *kiln_draco_decode(const void *data, size_t size, char *reason, size_t reason_size);
void kiln_draco_destroy(struct kiln_draco **draco);

size_t kiln_draco_vertex_count(const struct kiln_draco *draco);
size_t kiln_draco_triangle_count(const struct kiln_draco *draco);

/* Writes three corners per triangle as stored; they are not checked against the number of vertices. */
void kiln_draco_corners(const struct kiln_draco *draco, uint32_t *corners);

/* Writes the attribute with unique id `id`, `components` floats per vertex; integers are converted without
 * normalisation. Returns false if the attribute is missing, has another number of components, or lacks values. */
bool kiln_draco_attribute(const struct kiln_draco *draco, uint32_t id, unsigned components, float *values);

#ifdef __cplusplus
}
#endif

#endif
