/* Passes over tile runs: the tile runs of a part of a batch are distributed over threads, each with its own working
 * set. */
#ifndef KILN_WORKER_BACKEND_EMBREE_TILE_RUNS_H
#define KILN_WORKER_BACKEND_EMBREE_TILE_RUNS_H

#include <string.h>

#include "worker/backend/embree/passage.h"
#include "worker/light/light_groups.h"
#include "worker/pass/groups.h"

/* Functions of a pass over tile runs. */
struct tile_run_pass {
    /* Creates a thread's working set for samples and stream of the part; nothing remains after a failure. */
    int (*create)(void **work, const struct embree_backend *b, const void *parameters, const struct kiln_batch *part,
                  struct kiln_error *error);
    void (*destroy)(void **work); /* NULL is accepted */
    /* Computes one tile run. `results`: one for each of its points, all zeros. Adds its rays to *rays. */
    void (*run)(void *work, const struct embree_backend *b, struct embree_context *context, size_t tile_run,
                void *results, uint64_t *rays);
    size_t result_bytes; /* bytes of a point's result */
};

/* Runs the pass over the part; the arguments are those of embree_NAME in embree.h. */
int embree_each_tile_run(struct embree_backend *b, const struct tile_run_pass *pass, const void *parameters,
                         const struct kiln_batch *part, void *results, uint64_t *rays, struct kiln_error *error);

/* Returns the zeroed array for the light of groups of a tile run of the current part; NULL: not requested. */
static inline float *embree_group_run(const struct embree_backend *b, size_t tile_run)
{
    const struct kiln_groups *g = b->base.given.groups;
    const struct kiln_tile_run *run = &b->surface->tile_runs[tile_run];
    if (g == NULL)
        return NULL;
    const size_t floats = (size_t)g->lights->count * KILN_GROUP_FLOATS;
    float *answers = g->answers + (run->first.at - g->first) * floats;
    memset(answers, 0, run->count * floats * sizeof *answers);
    return answers;
}
/* Returns the answers for the tile run's point at `place`. */
static inline float *embree_group_answers(float *run, const struct embree_backend *b, uint32_t place)
{
    return run + (size_t)place * b->base.given.groups->lights->count * KILN_GROUP_FLOATS;
}

#endif
