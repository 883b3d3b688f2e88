/* kiln stop DIR: asks a running bake to save and end. */
#include <jansson.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/run/status_file.h"
#include "coordinator/cli/commands.h"
#include "coordinator/files/json.h"
#include "worker/base/text.h"

int kiln_command_stop(struct kiln_job *job, struct kiln_error *error)
{
    const char *directory = job->arguments[0];
    struct kiln_bake_status bake;
    int status = kiln_bake_status_read(directory, &bake, NULL);
    if (status != KILN_OK || !kiln_bake_status_alive(directory, &bake))
        return kiln_fail(error, KILN_NO_INPUT, "no bake is at work in %.500s (kiln status says more)", directory);
    status = kiln_stop_request(directory, error);
    if (status != KILN_OK)
        return status;
    if (job->json)
        return kiln_json_print(json_pack("{s:s, s:o}", "status", "done", "output", kiln_json_string(directory)), error);
    if (!job->quiet)
        kiln_print(stdout, "asked process %lld on %s to stop; it saves and ends with 75 (kiln status %s)\n",
                   (long long)bake.process, bake.host, directory);
    return KILN_OK;
}
