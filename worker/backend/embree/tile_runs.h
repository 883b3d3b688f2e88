/* Passes over tile runs: the threads share out the tile runs of a part of a batch, each with a working set of its own.
 */
#ifndef KILN_WORKER_BACKEND_EMBREE_TILE_RUNS_H
#define KILN_WORKER_BACKEND_EMBREE_TILE_RUNS_H

#include <string.h>

#include "worker/backend/embree/passage.h"
#include "worker/light/light_groups.h"
#include "worker/pass/groups.h"

/* Parts of a pass over tile runs. */
struct tile_run_pass {
    /* A thread's working set for samples and stream of the part; on failure there is none left. */
    int (*create)(void **work, const struct embree_backend *b, const void *parameters, const struct kiln_batch *part,
                  struct kiln_error *error);
    void (*destroy)(void **work); /* NULL is accepted */
    /* Computes one tile run. `results`: one for each of its points, all zeros. Adds its rays to *rays. */
    void (*run)(void *work, const struct embree_backend *b, struct embree_context *context, size_t tile_run,
                void *results, uint64_t *rays);
    size_t result_bytes; /* of a point */
};

/* Runs the pass over the part; the arguments are those of embree_NAME in embree.h. */
int embree_each_tile_run(struct embree_backend *b, const struct tile_run_pass *pass, const void *parameters,
                         const struct kiln_batch *part, void *results, uint64_t *rays, struct kiln_error *error);

/* Where the light of groups is to be put, of a tile run of the present part: all zeros; NULL: nobody asks. */
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
