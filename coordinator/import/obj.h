/* The OBJ reader, with MTL materials: kiln's own.
 *
 * Geometry: v (with w, which divides, or with a colour), vt, vn, and f with corners v, v/vt, v//vn, v/vt/vn. Indices
 * count from 1 or, if negative, backwards from the last. Polygons are triangulated (obj_polygon.h). Corners with the
 * same position, texture coordinate, normal and colour are one vertex, within consecutive faces of one material. No
 * normals are invented: without vn a face is flat, whatever s says.
 *
 * Objects: each "g NAME" that differs from the group before opens an object. "o NAME" continues the object of that
 * name, or opens one. Faces before either belong to "defaultobject". Objects without triangles are left out. usemtl
 * with a name that no material file defines makes a grey material (0.6) of that name. Faces before any usemtl have a
 * material called DefaultMaterial.
 *
 * Materials: Kd and map_Kd are the base colour; Ke and map_Ke the emitted radiance (1 if only the map is given); d or 1
 * - Tr the alpha. With a map, a black Kd counts as 1. Of map options -s, -o and -clamp are used, others skipped. map_d,
 * Pr and Pm are noted; unread statements are listed by keyword and count. Pictures are searched for as in find.c; a
 * missing one is white, or emits nothing.
 *
 * Positions are doubles, and multiplied by builder->unit; with builder->up_z (x, y, z) becomes (x, z, -y). An object
 * farther from the origin than 128 times its size is stored relative to its centre, and its transform moves it there.
 *
 * OBJ's v points up, kiln's down: v becomes 1 - v. OBJ has one set of texture coordinates. If no material of an object
 * has a texture, the set is used as the lightmap layout; otherwise it belongs to the textures.
 *
 * Free-form curves and surfaces, points, lines and unknown statements are left out and noted. An invalid number, an
 * index out of range, and a missing material file are refused with their line. */
#ifndef KILN_COORDINATOR_IMPORT_OBJ_H
#define KILN_COORDINATOR_IMPORT_OBJ_H

#include "coordinator/scene/builder.h"
#include "coordinator/import/confine.h"

/* Reads the scene file that `confine` was created for into an empty builder. KILN_BAD_INPUT, KILN_SYSTEM,
 * KILN_PERMISSION. */
int kiln_obj_read(struct kiln_confine *confine, struct kiln_builder *builder, struct kiln_error *error);

#endif
