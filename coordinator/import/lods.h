/* Levels of detail: models of one thing that stand at one place, of which an engine shows one at a time. Light between
 * them is nonsense, so one of them is baked, the finest, and the others are left out.
 *
 * An object's level is what its file says:
 * - a name that ends in LOD and a number ("ball_LOD1", "Ball.lod2", "LOD0"), or begins so ("LOD1_ball"): that of its
 *   node, of a node above it, or of its mesh; the number of a copy behind it ("_12", ".001") does not count
 * - glTF's MSFT_lod: a node of `ids` is a level, as are the nodes below it (gltf_lod.c)
 * - a number as `lod`, `LOD`, `lod_level`, `lodLevel` or `LODLevel` in the extras of its node, of a node above it, or
 *   of its mesh
 *
 * A level is left out where a finer one of the same thing is there: one that MSFT_lod connects with it, wherever it
 * stands; or at the same place one of the same name but for the level ("ball", too), or of any name where extras say
 * the level. Two models are at one place if their boxes' diagonals differ by at most a factor of two, and their centres
 * by at most a quarter of the longer one. So levels side by side are things of their own, and so is a level whose finer
 * ones are excluded, or that the settings say not to exclude (exclude: false). */
#ifndef KILN_COORDINATOR_IMPORT_LODS_H
#define KILN_COORDINATOR_IMPORT_LODS_H

#include "coordinator/scene/builder.h"

/* Finds the level that a name gives, *level; the name without it and without the number of a copy is *length bytes from
 * *begin on. False: it gives no level. */
bool kiln_lod_of_name(const char *name, uint32_t *level, const char **begin, size_t *length);

/* Marks the builder's objects that are to be left out (KILN_EXCLUDE_YES), and adds a note that names them. Those that
 * are excluded already do not count. KILN_SYSTEM. */
int kiln_lods_leave_out(struct kiln_builder *builder, size_t *count, struct kiln_error *error);

#endif
