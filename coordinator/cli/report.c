/* kiln report: report.html of a finished bake. */
#include "coordinator/output/report.h"

#include <stdio.h>

#include <jansson.h>

#include "coordinator/cli/commands.h"
#include "coordinator/output/publish.h"

int kiln_command_report(struct kiln_job *job, struct kiln_error *error)
{
    char fallback[KILN_PATH_SIZE];
    const char *path = job->output;
    int status = KILN_OK;
    if (path == NULL) {
        status = kiln_path_join(fallback, job->arguments[0], "report.html", error);
        path = fallback;
    }
    if (status == KILN_OK)
        status = kiln_report_write(job->arguments[0], path, error);
    if (status != KILN_OK)
        return status;
    if (job->json) {
        json_t *object = json_pack("{s:s, s:s}", "status", "done", "output", path);
        if (object != NULL && json_dumpf(object, stdout, JSON_COMPACT) == 0)
            (void)fputc('\n', stdout);
        json_decref(object);
    } else if (!job->quiet) {
        (void)puts(path);
    }
    return KILN_OK;
}
