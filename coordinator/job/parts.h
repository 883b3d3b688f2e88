/* The parts of a scene, as a job file lists them: many files that are put together to one scene.
 *
 *     parts:
 *       - {name: ground, file: ground.glb}
 *       - name: house
 *         file: models/house.obj
 *         at: [{translation: [10, 0, 0]}, {translation: [20, 0, 0], rotation: 90, scale: 1.5}]
 *
 * - name: 1 to 48 letters, digits, - and _; no other part has it, also without regard to upper and lower case. Objects
 * of the part are called NAME/OBJECT, and lightmaps/NAME is the folder of their lightmaps; so `back` and `groups-...`
 * are no names of parts.
 * - file: a .gltf, .glb or .obj file, relative to the job file.
 * - at: where the part stands; without it, as in its file. Either one place or a list of them. A place is a mapping of
 *   `translation` (m), `rotation` (a quaternion x, y, z, w as in glTF, or degrees about y) and `scale` (one factor or
 *   three), each of which may be absent; or the four rows of a matrix, the last 0 0 0 1. Of the second place and
 * further ones objects are called NAME.2/OBJECT, NAME.3/OBJECT, ... */
#ifndef KILN_COORDINATOR_JOB_PARTS_H
#define KILN_COORDINATOR_JOB_PARTS_H

#include <jansson.h>
#include <stddef.h>

#include "worker/base/status.h"

struct kiln_job;

enum { KILN_PART_NAME = 48 }; /* bytes of a name at most */

/* A part. The job owns all of it. */
struct kiln_part {
    char *name, *file;
    double (*at)[12]; /* affine maps (worker/base/affine.h) from the part's world to the scene's */
    size_t at_count;  /* at least 1 */
};

/* Reads one element of the list into `part`. `where` begins sentences ("job.yaml:7"), `folder` is where relative files
 * are; NULL: the current one. KILN_BAD_INPUT. */
int kiln_part_read(struct kiln_job *job, const json_t *json, const char *where, const char *folder,
                   struct kiln_part *part, struct kiln_error *error);

/* Takes over a list of parts, and checks that their names differ. `where` as before. KILN_BAD_INPUT, KILN_SYSTEM. */
int kiln_job_take_parts(struct kiln_job *job, const struct kiln_part *parts, size_t count, const char *where,
                        struct kiln_error *error);

/* Reads a list that kiln_job_parts_json wrote. */
int kiln_job_parts_read(struct kiln_job *job, const json_t *list, const char *where, struct kiln_error *error);

/* The job's parts as such a list, with real paths; NULL when out of memory. The caller owns it. */
json_t *kiln_job_parts_json(const struct kiln_job *job);

/* Checks that the files of all parts can be read. KILN_NO_INPUT, KILN_PERMISSION, KILN_BAD_INPUT for what is no file.
 */
int kiln_job_parts_check(const struct kiln_job *job, struct kiln_error *error);

#endif
