/* kiln report: writes report.html of a finished bake. */
#include "coordinator/view/report.h"

#include <stdio.h>

#include <jansson.h>

#include "coordinator/run/lock.h"
#include "coordinator/cli/commands.h"
#include "coordinator/files/json.h"
#include "coordinator/files/output_name.h"
#include "coordinator/files/publish.h"
#include "worker/base/text.h"

int kiln_command_report(struct kiln_job *job, struct kiln_error *error)
{
    char fallback[KILN_PATH_SIZE];
    const char *path = job->output;
    int status = KILN_OK;
    if (path == NULL) {
        status = kiln_path_join(fallback, job->arguments[0], "report.html", error);
        path = fallback;
    }
    const struct kiln_output_name name = {.option = "--output", .path = path, .bakes = {job->arguments[0]}};
    KILN_TRY(status);
    KILN_TRY(kiln_output_name_check(&name, error));
    if (job->output == NULL)
        KILN_TRY(kiln_lock_refuse(job->arguments[0], error));
    KILN_TRY(kiln_report_write(job->arguments[0], path, error));
end:
    if (status != KILN_OK)
        return status;
    if (job->json)
        return kiln_json_print(json_pack("{s:s, s:o}", "status", "done", "output", kiln_json_string(path)), error);
    if (!job->quiet)
        kiln_print(stdout, "%s\n", path);
    return KILN_OK;
}
