/* The gather pass, whose loop the guided and the directions pass run too: a thread's working set, and one tile run. */
#ifndef KILN_WORKER_BACKEND_EMBREE_GATHER_H
#define KILN_WORKER_BACKEND_EMBREE_GATHER_H

#include "worker/backend/embree/directed.h"
#include "worker/backend/embree/hemisphere.h"
#include "worker/backend/embree/kept_rows.h"
#include "worker/backend/embree/ray_probes.h"
#include "worker/backend/embree/run_guide.h"

struct gather_work {
    struct hemisphere h;
    struct kept_rows rows;                       /* of the gather pass; else zeros */
    struct ray_probes probes;                    /* where the backend has some */
    bool chained[RAY_LANES];                     /* lanes that go on in chains */
    double plain[3][RAY_LANES];                  /* of rays that all weigh 1: incident light */
    const struct kiln_guided_parameters *guided; /* of the guided pass; else NULL */
    struct run_guide guide;
    /* of the directions pass, else NULL: where its rays go, and what their light is multiplied by */
    struct directed *directed;
    const struct kiln_directions_parameters *directions;
    double *groups; /* the light of groups: of each point and group KILN_GROUP_FLOATS sums; NULL: nobody asks */
};

/* Functions of struct tile_run_pass (tile_runs.h). No parameters are read: who has some sets them afterwards. */
int gather_work_create(void **work, const struct embree_backend *b, const struct kiln_batch *part,
                       struct kiln_error *error);
void gather_work_destroy(void **work);
void gather_tile_run(void *work, const struct embree_backend *b, struct embree_context *context, size_t tile_run,
                     void *results, uint64_t *rays);

#endif
