/* The glTF 2.0 reader (.gltf, .glb): strict.
 *
 * It is kiln's own reader, built on jansson. A baker needs data that other readers drop, and must survive files that
 * other readers do not: Assimp 5.2.5 loses KHR_materials_emissive_strength (a lamp of 10 becomes 1) and flips texture
 * coordinates; hand-made files crash it or make it take gigabytes (nested arrays, long node chains, 1,195 bytes of
 * sparse accessor). tinygltf is C++ with a recursive parser of its own. jansson is C, rejects duplicate keys, invalid
 * UTF-8 and overflowing numbers, and bounds nesting (2,048).
 *
 * Nothing is believed before it is checked, and nothing is allocated for a number that the file merely claims.
 * Accessors are read in place, element by element, so a sparse or empty accessor of any count costs nothing. Limits,
 * each reported by name:
 *   JSON objects and arrays            2^21
 *   nodes, meshes, accessors, ...      what the JSON holds
 *   triangles stored                   65,536 + 1 for each byte of the scene's files (an index takes at least a byte),
 *                                      + 64 for each byte of Draco data (a triangle takes a bit or two)
 *   decompressed buffer views          65,536 + 256 bytes for each byte of meshopt data
 *   sparse elements                    65,536 + 1 for each byte of the scene's files
 *   objects, instances expanded        65,536 + 1 for each byte of the scene's files, at most 2^20
 *   triangles, instances expanded      2^30
 *   triangles of skinned meshes        2^20 + 4 for each byte of the scene's files, stored for each node
 *   texels                             see coordinator/import/image.h
 *   side of an image                   16,384
 *   depth of the node tree             none: it is walked without recursion
 *
 * Rules where the specification leaves a choice, or where files go beyond it:
 * - `scene` chooses the scene; without it the first; without any scene the result is empty.
 * - A node.matrix whose last row is not 0 0 0 1, or whose 3 x 3 part is singular, is refused (the specification demands
 *   that it decomposes). A zero TRS scale is legal: the object is kept if it still has an area, else left out with a
 *   note.
 * - A primitive without material is diffuse grey of 0.8. (The specification's default, white metal, reflects no diffuse
 *   light.)
 * - A metallic texture is replaced by the mean of its blue channel, times the factor. Notes say what becomes of alpha,
 *   occlusion and normal maps.
 * - Points and lines are left out. They, extensions that are not read, animations and other things that no bake uses
 *   are named by kind and count (gltf_unused.c), and so are lamps of other extensions, as a warning.
 * - A skin's joints place its mesh, and morph targets have the weights that the file gives (gltf_pose.h).
 * - What KHR_node_visibility hides has neither mesh nor light; its transform still counts.
 * - An unlit material is diffuse in its base colour, without emission, metal or gloss.
 *   KHR_materials_pbrSpecularGlossiness, where a material has it, counts in place of pbrMetallicRoughness.
 * - A picture whose file is missing is white; but it emits nothing, and makes nothing metal (missing.h). A normal map
 *   that cannot be decoded is left out.
 * - emissiveFactor above 1 is used as it is, with a note; every other factor outside its range is refused. */
#ifndef KILN_COORDINATOR_IMPORT_GLTF_H
#define KILN_COORDINATOR_IMPORT_GLTF_H

#include "coordinator/scene/builder.h"
#include "coordinator/import/confine.h"

/* Reads the scene file that `confine` was created for into an empty builder. KILN_BAD_INPUT, KILN_SYSTEM,
 * KILN_PERMISSION. */
int kiln_gltf_read(struct kiln_confine *confine, struct kiln_builder *builder, struct kiln_error *error);

#endif
