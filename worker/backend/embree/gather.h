/* The gather pass: a thread's working set, and the processing of one tile run. The guided and the directions pass use
 * its loop, too. */
#ifndef KILN_WORKER_BACKEND_EMBREE_GATHER_H
#define KILN_WORKER_BACKEND_EMBREE_GATHER_H

#include "worker/backend/embree/directed.h"
#include "worker/backend/embree/hemisphere.h"
#include "worker/backend/embree/kept_rows.h"
#include "worker/backend/embree/ray_probes.h"
#include "worker/backend/embree/run_guide.h"

struct gather_work {
    struct hemisphere h;
    struct kept_rows rows;                       /* kept rows of the gather pass; else zeros */
    struct ray_probes probes;                    /* radiance probes, if the backend has them */
    bool chained[RAY_LANES];                     /* lanes at whose hits chains begin */
    double plain[3][RAY_LANES];                  /* incident light of steps in which all rays have weight 1 */
    const struct kiln_guided_parameters *guided; /* parameters of the guided pass; else NULL */
    struct run_guide guide;
    /* directions pass, else NULL: targets of its rays, and factors of their light */
    struct directed *directed;
    const struct kiln_directions_parameters *directions;
    double *groups; /* light of groups: KILN_GROUP_FLOATS sums for each point and group; NULL: not requested */
};

/* Functions of struct tile_run_pass (tile_runs.h). They read no parameters: passes that have some set them afterwards.
 */
int gather_work_create(void **work, const struct embree_backend *b, const struct kiln_batch *part,
                       struct kiln_error *error);
void gather_work_destroy(void **work);
void gather_tile_run(void *work, const struct embree_backend *b, struct embree_context *context, size_t tile_run,
                     void *results, uint64_t *rays);

#endif
