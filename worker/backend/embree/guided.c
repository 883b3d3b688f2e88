/* The guided pass (worker/pass/guided.h): the gather pass with a guide. */
#include "worker/backend/embree/gather.h"
#include "worker/backend/embree/tile_runs.h"

_Static_assert(offsetof(struct kiln_guided_result, point) == 0, "what hemisphere_store writes");

static int guided_create(void **work, const struct embree_backend *b, const void *parameters,
                         const struct kiln_batch *part, struct kiln_error *error)
{
    const int status = gather_work_create(work, b, part, error);
    if (status == KILN_OK)
        ((struct gather_work *)*work)->guided = parameters;
    return status;
}

int embree_guided(struct embree_backend *b, const void *parameters, const struct kiln_batch *part, void *results,
                  uint64_t *rays, struct kiln_error *error)
{
    static const struct tile_run_pass pass = {guided_create, gather_work_destroy, gather_tile_run,
                                              sizeof(struct kiln_guided_result)};
    return embree_each_tile_run(b, &pass, parameters, part, results, rays, error);
}
