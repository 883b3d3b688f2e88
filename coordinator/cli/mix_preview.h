/* The preview of a mixture, with the camera and exposure of the bake's preview, so that the two can be compared. */
#ifndef KILN_COORDINATOR_CLI_MIX_PREVIEW_H
#define KILN_COORDINATOR_CLI_MIX_PREVIEW_H

#include <jansson.h>

#include "coordinator/job/job.h"

/* Draws preview.png of the lightmaps and the scene.kscene below `directory`, which this process has just written.
 * `run`: the report of the bake; its "preview" becomes that of the new picture. Not collective.
 * KILN_SYSTEM, and the failures of reading the scene and of writing the picture. */
int kiln_mix_preview(const char *directory, const struct kiln_job *job, json_t *run, struct kiln_error *error);

#endif
