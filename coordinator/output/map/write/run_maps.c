#include "coordinator/output/map/write/writer.h"

#include <omp.h>

#include "coordinator/mpi/agree.h"
#include "coordinator/output/map/bands/bands.h"
#include "coordinator/output/map/seams/joined.h"
#include "coordinator/output/map/write/stages.h"

double kiln_writer_take_denoising(const struct kiln_writer *w, uint32_t object)
{
    const double seconds = w->works[object].denoising;
    w->works[object].denoising = 0.0;
    return seconds;
}

int kiln_writer_begin(const struct kiln_writer *w, uint32_t object, struct kiln_error *error)
{
    struct kiln_map_work *work = &w->works[object];
    if (work->next > 0)
        return KILN_OK;
    int status = kiln_bands_agree(work->map, kiln_writer_check_arrived(w, object, error), error);
    if (status == KILN_OK)
        status = kiln_map_stages_begin(kiln_map_stages, work, error);
    if (!omp_in_parallel()) /* else run_side_by_side does it */
        *w->denoising += kiln_writer_take_denoising(w, object);
    return status;
}

int kiln_writer_complete(const struct kiln_writer *w, uint32_t object, struct kiln_error *error)
{
    const int status = kiln_writer_begin(w, object, error);
    return status == KILN_OK ? kiln_map_stages_run(kiln_map_stages, &w->works[object], error) : status;
}

int kiln_writer_solve_alone(const struct kiln_writer *w, const struct kiln_assignment *assignment, uint32_t object,
                            struct kiln_error *error)
{
    struct kiln_map_work *work = &w->works[object];
    const struct kiln_joined_params params = {.communicator = w->result->communicator,
                                              .alone = object,
                                              .lightmaps = w->result->surface->lightmaps,
                                              .assignment = assignment,
                                              .planes = &w->layers.planes,
                                              .measure = !w->params->stitch};
    struct kiln_joined *alone = NULL;
    int status;
    KILN_TRY(kiln_writer_begin(w, object, error));
    KILN_TRY(kiln_agree(w->result->communicator, kiln_joined_create(&alone, &params, error), error));
    KILN_TRY(kiln_joined_add(alone, object, work->map, work->graph, work->nearest, error));
    KILN_TRY(kiln_joined_solve(alone, error));
end:
    work->joined = alone;
    if (status == KILN_OK)
        status = kiln_map_stages_run(kiln_map_stages, work, error);
    work->joined = NULL;
    kiln_joined_destroy(&alone);
    return status;
}
