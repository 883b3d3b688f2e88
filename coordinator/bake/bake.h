/* A bake: the pipeline from a scene to the files of results.
 *
 * In this order: output folder and its lock; checkpoint to continue from; import, surface points and backend
 * (prepare.h); light (integrate/integrate.h); volume (volume.h); lightmaps, kiln.h5, volume.hdf, scene.glb,
 * preview.png, run.json and manifest. Progress, notes and warnings go to stderr, from rank 0; nothing goes to stdout.
 */
#ifndef KILN_COORDINATOR_BAKE_BAKE_H
#define KILN_COORDINATOR_BAKE_BAKE_H

#include <jansson.h>
#include <mpi.h>

#include "coordinator/job/job.h"

struct kiln_bake;

/* Collective over `communicator`. Bakes job->scene.file into the folder job->output. Every rank passes the same job,
 * which must outlive the bake. Returns the same status on all ranks: KILN_OK when all files are written; KILN_STOPPED
 * when a signal, --max-time or `kiln stop` has ended the bake, with a checkpoint of all that was computed. The exit
 * codes of other failures are in worker/base/status.h. Whatever the status, end with kiln_bake_end; *bake is NULL if
 * memory was short. */
int kiln_bake_run(struct kiln_bake **bake, MPI_Comm communicator, const struct kiln_job *job, struct kiln_error *error);

/* The content of run.json on rank 0, NULL elsewhere. Borrowed. Only after KILN_OK. */
json_t *kiln_bake_report(const struct kiln_bake *bake);
/* Where preview.png is seen from, in words (kiln_viewpoint_text), on rank 0. NULL: elsewhere, without preview, and in a
 * quiet bake. Borrowed. */
const char *kiln_bake_preview(const struct kiln_bake *bake);

/* Collective. Ends a bake and releases it; accepts NULL. `status` is the same on all ranks: that of kiln_bake_run, or
 * of what was done with the results afterwards; `error` has its sentence. After KILN_OK the checkpoint is removed.
 * After any other status the checkpoint is kept for the next bake, and an empty output folder that this bake made is
 * removed. From this call on signals end the process (kiln_process_release). */
void kiln_bake_end(struct kiln_bake **bake, int status, const struct kiln_error *error);

#endif
