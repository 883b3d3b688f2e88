/* Levels of detail: several models of one thing at one place, of which an engine shows one at a time. Light between
 * them is meaningless, so only the finest is baked, and the others are left out.
 *
 * The file gives an object's level in one of these ways: - a name that ends in LOD and a number ("ball_LOD1",
 * "Ball.lod2", "LOD0"), or begins so ("LOD1_ball"): the name of its
 *   node, of a node above it, or of its mesh; a copy number at the end ("_12", ".001") is ignored
 * - glTF's MSFT_lod: a node of `ids` is a level, and so are the nodes below it (gltf_lod.c) - a number as `lod`, `LOD`,
 * `lod_level`, `lodLevel` or `LODLevel` in the extras of its node, of a node above it, or of
 *   its mesh
 *
 * A level is left out if the scene has a finer level of the same thing. With MSFT_lod this is a level that the
 * extension connects with it, at any place. Otherwise it is a level at the same place whose name differs only in the
 * level (also plain "ball"), or with any name if extras give the level. Two models are at one place if their boxes'
 * diagonals differ by at most a factor of two, and their centres by at most a quarter of the longer one. So levels side
 * by side are separate things. A level is also kept if its finer levels are excluded, or if its settings say exclude:
 * false. */
#ifndef KILN_COORDINATOR_IMPORT_LODS_H
#define KILN_COORDINATOR_IMPORT_LODS_H

#include "coordinator/scene/builder.h"

/* Parses the level in a name into *level. The name without the level and without a copy number is *length bytes from
 * *begin on. Returns false if the name gives no level. */
bool kiln_lod_of_name(const char *name, uint32_t *level, const char **begin, size_t *length);

/* Returns the name that has an object's level: `found`, that of the node found by the reader, or if it is NULL that of
 * the object's node or its mesh. */
const char *kiln_lod_name(const char *found, const char *node, const char *mesh);

/* Marks the builder's coarser levels to be left out (KILN_EXCLUDE_YES), and adds a note that names them. Objects that
 * are already excluded do not count. KILN_SYSTEM. */
int kiln_lods_leave_out(struct kiln_builder *builder, size_t *count, struct kiln_error *error);

#endif
