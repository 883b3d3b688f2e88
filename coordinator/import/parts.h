/* Scenes in parts: many files that are read one by one, each by a confined child of its own, and put together.
 *
 * A folder of parts has a scene file for each part, PART.kscene (KILN_SCENE_VERSION_PART): what the reader took from
 * the part's file, before anything that the job says of the whole scene. It is a cache as any scene file is (import.h),
 * so only files that have changed are read again. Beside them stands KILN_PART_LIST, JSON: the parts in their order,
 * each with the hash of its scene and its places. Importing this list puts the scene together, in a confined child that
 * may read that folder alone: it appends the parts, each as often as it has places, and goes on as for a scene of one
 * file (read.h). So lightmaps have the same bits as those of one file with the same objects in the same order.
 *
 * What comes from a part:
 * - objects, lights, cameras: once a place, called PART/NAME, in the second place PART.2/NAME, ...; lights of all parts
 *   add up; the scale of a place changes no light's intensity and range, as in glTF
 * - materials, textures, meshes: once; materials and meshes are called PART/NAME
 * - the environment: the first part that has one gives it, unless the job names one; a note tells of the others
 * - the unit of lights: the first part that states one; a note tells of others
 * - notes, with the part's name in front; what several parts have in common is one note */
#ifndef KILN_COORDINATOR_IMPORT_PARTS_H
#define KILN_COORDINATOR_IMPORT_PARTS_H

#include <sys/stat.h>

#include "coordinator/import/confine.h"
#include "coordinator/import/import.h"
#include "coordinator/job/parts.h"

#define KILN_PART_LIST "scene.parts"

/* Findings of the import of a part. Plain data, which ranks send one another; all zero: another rank has it. */
struct kiln_part_import {
    uint64_t hash[2]; /* of the part's scene, without the key of its import */
    uint64_t objects, triangles;
    double seconds;
    uint32_t read, rank; /* read: 1 if its file was read, 0 if its scene file was up to date */
    /* of the part's file when it was read */
    uint64_t size, device, inode;
    int64_t modified_seconds, modified_nanoseconds;
};

/* Imports a part to FOLDER/NAME.kscene. Of `base` only what concerns single files counts. Not collective. Sentences
 * begin with the part's name. KILN_IO if the file changed while it was read; else as kiln_import. */
int kiln_import_part(const struct kiln_import_params *base, const struct kiln_part *part, const char *folder,
                     struct kiln_part_import *result, struct kiln_error *error);

/* Whether the part's file is still what it was when it was read, as far as its size and time tell. */
bool kiln_part_is_unchanged(const struct kiln_part *part, const struct kiln_part_import *result);

/* Publishes the list of parts in the folder. Not collective. */
int kiln_part_list_write(const char *folder, const struct kiln_part *parts, const struct kiln_part_import *imports,
                         size_t count, struct kiln_error *error);

/* Hash of a part's scene: of all its bytes but the key of its import and its own hash. */
void kiln_part_hash(const struct kiln_scene *scene, uint64_t hash[2]);

/* Reads the list for which `confine` was created, and appends all parts to an empty builder. `asked`: the job names an
 * environment. The confined child calls it. KILN_BAD_INPUT, KILN_IO if a part's scene file is another than the list
 * says, KILN_SYSTEM. */
int kiln_parts_read(struct kiln_confine *confine, struct kiln_builder *builder, bool asked, struct kiln_error *error);

#endif
