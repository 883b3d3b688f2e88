/* OBJ with MTL: kiln's own reader.
 *
 * Geometry: v (with w, which divides, or with a colour), vt, vn, f with corners v, v/vt, v//vn, v/vt/vn, counted from 1
 * or, negative, back from the last. A polygon is cut into triangles as obj_polygon.h says. Corners with the same
 * position, texture coordinate, normal and colour are one vertex, within faces of one material that follow each other.
 * No normals are made up: without vn a face is flat, whatever s says.
 *
 * Objects: each "g NAME" that differs from the group before opens an object; "o NAME" goes on with the object of that
 * name or opens one; faces before either belong to "defaultobject". Objects without triangles are left out. usemtl of a
 * name that no material file has makes a grey material (0.6) of that name; faces before any usemtl have one called
 * DefaultMaterial.
 *
 * Materials: Kd and map_Kd are the base colour, Ke and map_Ke the emitted radiance (1 where only the map is given), d
 * or 1 - Tr the alpha. Maps: -s, -o and -clamp are heeded, other options skipped. map_d, Pr and Pm are noted; what else
 * MTL has says nothing of diffuse light.
 *
 * OBJ's v points up, kiln's down: v becomes 1 - v. OBJ has one set of texture coordinates: where no material of an
 * object has a texture it is offered as the lightmap layout, else it belongs to the textures.
 *
 * Free-form curves and surfaces, points, lines and statements that kiln does not know are left out and noted. A number
 * that is none, an index that leads nowhere, a material file or a picture that is missing are refused with their line.
 */
#ifndef KILN_COORDINATOR_IMPORT_OBJ_H
#define KILN_COORDINATOR_IMPORT_OBJ_H

#include "coordinator/scene/builder.h"
#include "coordinator/import/confine.h"

/* Reads the scene `confine` was made for into an empty builder. KILN_BAD_INPUT, KILN_SYSTEM, KILN_PERMISSION. */
int kiln_obj_read(struct kiln_confine *confine, struct kiln_builder *builder, struct kiln_error *error);

#endif
