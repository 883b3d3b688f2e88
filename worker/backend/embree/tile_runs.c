#include "worker/backend/embree/tile_runs.h"

#include <string.h>

int embree_each_tile_run(struct embree_backend *b, const struct tile_run_pass *pass, const void *parameters,
                         const struct kiln_batch *part, void *results, uint64_t *rays, struct kiln_error *error)
{
    const struct kiln_tile_run *tile_runs = b->surface->tile_runs + part->first;
    uint64_t traced = 0;
    double seconds = 0.0;
    int status = KILN_OK;
#pragma omp parallel num_threads((int)b->threads) reduction(+ : traced, seconds)
    {
        void *work = NULL;
        struct kiln_error own;
        const int created = pass->create(&work, b, parameters, part, &own);
        if (created != KILN_OK) {
#pragma omp critical(kiln_tile_runs_status)
            status = kiln_fail(error, created, "%s", own.message);
        }
#pragma omp barrier
        const unsigned saved = embree_enter();
        struct embree_context context;
        embree_context(b, &context);
        const double begin = embree_thread_seconds();
#pragma omp for schedule(dynamic, 4) nowait
        for (size_t i = 0; i < part->count; i++) {
            if (status != KILN_OK || kiln_batch_leaves_out(part, part->first + i))
                continue;
            char *run = (char *)results + (tile_runs[i].first.at - tile_runs[0].first.at) * pass->result_bytes;
            memset(run, 0, tile_runs[i].count * pass->result_bytes);
            pass->run(work, b, &context, part->first + i, run, &traced);
        }
        seconds += embree_thread_seconds() - begin;
        embree_leave(saved);
        pass->destroy(&work);
    }
    *rays += traced;
    b->thread_seconds += seconds;
    return status;
}
