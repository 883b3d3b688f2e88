/* kiln bake: from the scene to the output files. */
#include <stdio.h>

#include "coordinator/bake/bake.h"
#include "coordinator/bake/report/run_report.h"
#include "coordinator/bake/report/run_table.h"
#include "coordinator/cli/commands.h"
#include "coordinator/files/json.h"
#include "coordinator/mpi/agree.h"
#include "worker/base/text.h"

/* Warns, as the last line of output, that nothing in the scene shines: such a bake looks like one that failed. */
static void warn_of_darkness(const struct kiln_bake *bake, FILE *stream)
{
    if (json_is_false(json_object_get(json_object_get(kiln_bake_report(bake), "scene"), "lit")))
        (void)fputs("WARNING " KILN_NO_LIGHT "; all is black, no ray was traced, and there is no volume\n", stream);
}

/* Rank 0. Prints the results, when nothing can fail any more. */
static int print_results(const struct kiln_bake *bake, const struct kiln_job *job, struct kiln_error *error)
{
    if (job->json) {
        const int status = kiln_json_print(json_incref(kiln_bake_report(bake)), error);
        if (!job->quiet)
            warn_of_darkness(bake, stderr);
        return status;
    }
    if (job->quiet)
        return KILN_OK;
    kiln_run_table(stdout, kiln_bake_report(bake));
    if (kiln_bake_preview(bake) != NULL)
        kiln_print(stdout, "preview.png  %s\n", kiln_bake_preview(bake));
    warn_of_darkness(bake, stdout);
    return KILN_OK;
}

int kiln_command_bake(struct kiln_job *job, struct kiln_error *error)
{
    struct kiln_bake *bake;
    int rank;
    (void)MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    int status = kiln_bake_run(&bake, MPI_COMM_WORLD, job, error);
    if (status == KILN_OK)
        status = kiln_agree(MPI_COMM_WORLD, rank == 0 ? print_results(bake, job, error) : KILN_OK, error);
    kiln_bake_end(&bake, status, error);
    return status;
}
