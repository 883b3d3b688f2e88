/* OBJ, PLY, STL and the like, through Assimp's C interface (which reads them well; not glTF: see gltf.h).
 *
 * Assimp opens files through us only, so it reaches nothing outside the scene's folder. An OBJ is walked through once before
 * that, so that a number that is none or an index that leads nowhere is named with its line. Each node with faces becomes one
 * mesh and one object. MTL: Kd and map_Kd are the base colour, Ke and map_Ke the emitted radiance, d the alpha. OBJ's v points
 * up, kiln's down: v becomes 1 - v. OBJ has one set of texture coordinates: where no material of a node has a texture it is
 * offered as the lightmap layout, else it belongs to the textures. */
#ifndef KILN_COORDINATOR_IMPORT_OBJ_H
#define KILN_COORDINATOR_IMPORT_OBJ_H

#include "coordinator/import/builder.h"
#include "coordinator/import/confine.h"

/* Reads the scene `confine` was made for into an empty builder. KILN_BAD_INPUT, KILN_SYSTEM, KILN_PERMISSION. */
int kiln_obj_read(struct kiln_confine *confine, struct kiln_builder *builder, struct kiln_error *error);

/* Walks through the text of an OBJ file; KILN_BAD_INPUT with the line for what Assimp would take for something else. */
int kiln_obj_check(const char *scene, const unsigned char *text, size_t size, struct kiln_error *error);

#endif
