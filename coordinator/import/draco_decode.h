/* Draco (KHR_draco_mesh_compression), through a C interface: the library has none, so that draco_decode.cpp is kiln's
 * one C++ file. No exception leaves it. Nothing here is collective; a mesh is used by one thread at a time.
 *
 * The library is not made for hostile input: it may take memory for numbers that the data merely claims, and is only
 * ever called in the confined child, whose limits bound it. */
#ifndef KILN_COORDINATOR_IMPORT_DRACO_DECODE_H
#define KILN_COORDINATOR_IMPORT_DRACO_DECODE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

struct kiln_draco;

/* Decodes a triangle mesh. NULL, and why in `reason`, when the data is none. Destroy with kiln_draco_destroy. */
struct kiln_draco *kiln_draco_decode(const void *data, size_t size, char *reason, size_t reason_size);
void kiln_draco_destroy(struct kiln_draco **draco);

size_t kiln_draco_vertex_count(const struct kiln_draco *draco);
size_t kiln_draco_triangle_count(const struct kiln_draco *draco);

/* Three a triangle, as the data has them: not checked against the number of vertices. */
void kiln_draco_corners(const struct kiln_draco *draco, uint32_t *corners);

/* The attribute of that unique id, `components` floats a vertex; integers as they are, not normalised. False when there
 * is no such attribute, when it has another number of components, or when values are missing. */
bool kiln_draco_attribute(const struct kiln_draco *draco, uint32_t id, unsigned components, float *values);

#ifdef __cplusplus
}
#endif

#endif
