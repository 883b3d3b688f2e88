/* kiln bench rays and kiln bench scaling: measurements on this machine. Other benches are studies (studies.h). */
#include <stdio.h>
#include <string.h>

#include "coordinator/bake/rays_bench.h"
#include "coordinator/mpi/agree.h"
#include "coordinator/cli/commands.h"
#include "coordinator/cli/scaling.h"
#include "coordinator/files/temporary.h"

static int bench_rays(struct kiln_job *job, const char *scene_file, struct kiln_error *error)
{
    struct kiln_prepared *prepared = NULL;
    struct kiln_phases phases = {0};
    struct kiln_rays_bench result = {0};
    if (job->machine.backend == NULL || strcmp(job->machine.backend, "vulkan") != 0)
        job->machine.threads = 1;
    const struct kiln_prepare_care care = {.device_first = true};
    int status;
    KILN_TRY(kiln_prepare(&prepared, MPI_COMM_SELF, job, scene_file, &phases, NULL, &care, error));
    KILN_TRY(kiln_rays_bench(prepared, job->light.samples_indirect, job->bench.repeats, &result, error));
    if (job->json)
        (void)printf("{\"status\":\"done\",\"rays\":%llu,\"triangles\":%zu,\"pass_mrays_per_second\":%.4f,\"tracer_"
                     "mrays_per_second\":%.4f,\"share\":%.4f,"
                     "\"share_least\":%.4f,\"share_most\":%.4f}\n",
                     (unsigned long long)result.rays, prepared->geometry->triangle_count, result.pass_rate * 1e-6,
                     result.ceiling_rate * 1e-6, result.share, result.share_low, result.share_high);
    else
        (void)printf("%zu triangles, %llu surface points, %llu rays a run, %u runs, %s\nbounce pass  %8.3f "
                     "Mrays/s\ntracer alone %8.3f Mrays/s\n"
                     "share        %8.3f (%.3f to %.3f)\n",
                     prepared->geometry->triangle_count, (unsigned long long)prepared->surface->point_count,
                     (unsigned long long)result.rays, job->bench.repeats, result.info.device, result.pass_rate * 1e-6,
                     result.ceiling_rate * 1e-6, result.share, result.share_low, result.share_high);
end:
    kiln_prepared_destroy(&prepared);
    return status;
}

int kiln_command_bench(struct kiln_job *job, struct kiln_error *error)
{
    const char *name = job->arguments[0];
    const bool rays = strcmp(name, "rays") == 0, scaling = strcmp(name, "scaling") == 0;
    if (!rays && !scaling)
        return kiln_fail(error, KILN_USAGE, "'%.100s' is no bench that comes behind options: give its name first",
                         name);
    if (job->argument_count != 2)
        return kiln_fail(error, KILN_USAGE, "kiln bench %s takes one scene; for example: kiln bench %s room.glb", name,
                         name);
    if (scaling)
        return kiln_scaling_bench(job, error);
    int rank;
    (void)MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    int status = KILN_OK;
    if (rank == 0) { /* only rank 0 measures */
        struct kiln_temporary temporary;
        status = kiln_temporary_make(&temporary, error);
        if (status == KILN_OK)
            status = bench_rays(job, temporary.scene_file, error);
        kiln_temporary_remove(&temporary);
    }
    return kiln_agree(MPI_COMM_WORLD, status, error);
}
