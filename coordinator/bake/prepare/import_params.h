/* Parameters of a job for the importer. */
#ifndef KILN_COORDINATOR_BAKE_PREPARE_IMPORT_PARAMS_H
#define KILN_COORDINATOR_BAKE_PREPARE_IMPORT_PARAMS_H

#include "coordinator/import/import.h"
#include "coordinator/job/job.h"

/* Parameters for the import of job->scene.file to the file `output`. Strings are borrowed, from the job too. `stop` may
 * be NULL: nothing asks to stop. */
struct kiln_import_params kiln_job_import_params(const struct kiln_job *job, const char *output,
                                                 const struct kiln_stop *stop);

#endif
