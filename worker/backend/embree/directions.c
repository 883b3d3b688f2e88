/* The directions pass (worker/pass/directions.h): the gather pass with other ray directions. */
#include "worker/backend/embree/gather.h"
#include "worker/backend/embree/tile_runs.h"

static int directions_create(void **work, const struct embree_backend *b, const void *parameters,
                             const struct kiln_batch *part, struct kiln_error *error)
{
    int status = gather_work_create(work, b, part, error);
    if (status != KILN_OK)
        return status;
    struct gather_work *w = *work;
    w->directions = parameters;
    status = directed_create(&w->directed, w->directions, part, error);
    if (status != KILN_OK)
        gather_work_destroy(work);
    return status;
}

int embree_directions(struct embree_backend *b, const void *parameters, const struct kiln_batch *part, void *results,
                      uint64_t *rays, struct kiln_error *error)
{
    static const struct tile_run_pass pass = {directions_create, gather_work_destroy, gather_tile_run,
                                              sizeof(struct kiln_point_result)};
    return embree_each_tile_run(b, &pass, parameters, part, results, rays, error);
}
