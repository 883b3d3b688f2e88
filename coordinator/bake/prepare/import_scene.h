/* Import of a job's scene, be it one file or parts (coordinator/import/parts.h).
 *
 * The scene files of parts lie in `parts` beside the scene file; where that has no name, in a temporary folder, which
 * is removed again. */
#ifndef KILN_COORDINATOR_BAKE_PREPARE_IMPORT_SCENE_H
#define KILN_COORDINATOR_BAKE_PREPARE_IMPORT_SCENE_H

#include <mpi.h>

#include "coordinator/import/parts.h"
#include "coordinator/job/job.h"

struct kiln_scene_import {
    struct kiln_import_report report;
    struct kiln_part_import *parts; /* one a part of the job; NULL: the scene is one file */
};

/* Collective. Imports the job's scene to `scene_file`, a path that all ranks share: each rank reads parts in turn, rank
 * 0 puts them together. All ranks return the same status; the report is rank 0's, `parts` are on all ranks. Release
 * with kiln_scene_import_release, also after a failure. */
int kiln_scene_import(struct kiln_scene_import *result, MPI_Comm communicator, const struct kiln_job *job,
                      const char *scene_file, const struct kiln_stop *stop, struct kiln_error *error);

/* Does the same without other ranks and without MPI. */
int kiln_scene_import_alone(struct kiln_scene_import *result, const struct kiln_job *job, const char *scene_file,
                            const struct kiln_stop *stop, struct kiln_error *error);
void kiln_scene_import_release(struct kiln_scene_import *result);

/* Writes a sentence that says how many parts there are and which were read: "2 parts, 1 of them read: house". */
void kiln_parts_sentence(const struct kiln_job *job, const struct kiln_part_import *imports, char *text, size_t size);

/* The first of the parts that this rank has read whose file has changed since; their number if none has. */
size_t kiln_parts_changed(const struct kiln_job *job, const struct kiln_part_import *imports, uint32_t rank);

/* Describes the parts, for reports; NULL: the scene is one file, or memory is short. The caller owns it. */
json_t *kiln_parts_report(const struct kiln_job *job, const struct kiln_part_import *imports);

#endif
