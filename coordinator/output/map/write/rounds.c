#include "coordinator/output/map/write/writer.h"

#include <omp.h>
#include <stdlib.h>

#include "coordinator/mpi/agree.h"
#include "worker/base/memory.h"

static int compare_texels(const void *a, const void *b, void *context)
{
    const struct kiln_lightmap *maps = context;
    const uint32_t i = *(const uint32_t *)a, j = *(const uint32_t *)b;
    const uint64_t p = (uint64_t)maps[i].width * maps[i].height, q = (uint64_t)maps[j].width * maps[j].height;
    return p != q ? (p > q ? -1 : 1) : (i > j) - (i < j);
}

uint64_t kiln_writer_texels(const struct kiln_writer *w, const uint32_t *own, size_t count)
{
    uint64_t texels = 0;
    for (size_t i = 0; i < count; i++)
        texels += (uint64_t)w->result->surface->lightmaps[own[i]].width * w->result->surface->lightmaps[own[i]].height;
    return texels;
}

/* Counts the objects, from the largest on, that are processed one after the other, each by all threads. A single thread
 * would still be at work on them when the others have run out of objects. */
static size_t count_alone(const struct kiln_writer *w, const uint32_t *own, size_t count, uint64_t threads)
{
    enum { LEAST = 1 << 16 }; /* texels from which on many threads have enough to do */
    uint64_t left = kiln_writer_texels(w, own, count);
    size_t alone = 0;
    for (; alone < count; alone++) {
        const uint64_t texels = kiln_writer_texels(w, own + alone, 1);
        if (texels < LEAST || 2 * threads * texels <= left)
            break;
        left -= texels;
    }
    return alone;
}

/* Calls `run` for each object, each by one thread. Keeps the message of the first object that failed. Charges denoising
 * with its share of the threads' time on objects. */
static int run_side_by_side(const struct kiln_writer *w, const uint32_t *own, size_t count, int threads,
                            int (*run)(const struct kiln_writer *, uint32_t, struct kiln_error *),
                            struct kiln_error *error)
{
    size_t first_failed = SIZE_MAX;
    int status = KILN_OK;
    const int team = count < (size_t)threads ? (int)count : threads;
    const double begin = omp_get_wtime();
    double all = 0.0, denoising = 0.0;
#pragma omp parallel for schedule(dynamic, 1) num_threads(team) reduction(+ : all, denoising)
    for (size_t i = 0; i < count; i++) {
        struct kiln_error mine = {{0}};
        omp_set_num_threads(1); /* for the loops within the object */
        const double start = omp_get_wtime();
        const int result = run(w, own[i], &mine);
        all += omp_get_wtime() - start;
        denoising += kiln_writer_take_denoising(w, own[i]);
        if (result == KILN_OK)
            continue;
#pragma omp critical(kiln_write_round)
        if (i < first_failed) {
            first_failed = i;
            status = kiln_fail(error, result, "%s", mine.message);
        }
    }
    if (denoising > 0.0)
        *w->denoising += (omp_get_wtime() - begin) * denoising / all;
    return status;
}

/* Lists own objects of the round in `own`, largest first, so that no thread starts a large one when the others are
 * done. Creates their maps, unless they have been kept. */
static int open_round(const struct kiln_writer *w, const struct kiln_assignment *assignment, uint32_t rank,
                      uint32_t round, uint32_t *own, size_t *count, struct kiln_error *error)
{
    *count = 0;
    for (size_t i = 0; i < assignment->count; i++) {
        const bool bands = assignment->owner[i] == KILN_IN_BANDS;
        if ((assignment->owner[i] != rank && !bands) || assignment->round[i] != round)
            continue;
        w->works[i].in_bands = bands;
        own[(*count)++] = (uint32_t)i;
    }
    qsort_r(own, *count, sizeof *own, compare_texels, w->result->surface->lightmaps);
    return run_side_by_side(w, own, *count, omp_get_max_threads(), kiln_writer_open, error);
}

int kiln_writer_run_some(const struct kiln_writer *w, const uint32_t *own, size_t count,
                         int (*run)(const struct kiln_writer *, uint32_t, struct kiln_error *),
                         struct kiln_error *error)
{
    const int threads = omp_get_max_threads();
    const size_t alone = count_alone(w, own, count, (uint64_t)threads);
    int status = KILN_OK;
    for (size_t i = 0; i < alone && status == KILN_OK; i++)
        status = run(w, own[i], error);
    return status == KILN_OK && count > alone ? run_side_by_side(w, own + alone, count - alone, threads, run, error)
                                              : status;
}

/* Collective. Receives the points of a round, and ghosts. */
static int gather_round(struct kiln_writer *w, struct kiln_texel_gather *gather, uint32_t round,
                        struct kiln_error *error)
{
    int status = kiln_texel_gather_round(gather, round, kiln_writer_put_point, w, error);
    if (status != KILN_OK)
        return status;
    if (w->ghost_status != KILN_OK)
        status = kiln_fail(error, w->ghost_status, "%s", w->ghost_error.message);
    return kiln_agree(w->result->communicator, status, error);
}

int kiln_writer_walk_rounds(struct kiln_writer *w, const struct kiln_assignment *assignment,
                            const struct kiln_assignment *gathered, const struct kiln_ghosts *ghosts,
                            int (*finish)(struct kiln_writer *, const struct kiln_assignment *, uint32_t round,
                                          uint32_t *own, size_t count, struct kiln_error *),
                            struct kiln_error *error)
{
    const MPI_Comm comm = w->result->communicator;
    struct kiln_texel_gather *gather = NULL;
    uint32_t *own = NULL;
    const size_t wide = w->layers.planes.count > 64 ? (64ull << 18) / w->layers.planes.count : 0; /* records a pass */
    int status = kiln_texel_gather_create(&gather, w->result, gathered, &w->layers, ghosts, wide, error);
    if (status != KILN_OK)
        return status;
    status = kiln_agree(comm, kiln_allocate(&own, assignment->count, sizeof *own, "objects to write", error), error);
    for (uint32_t round = 0; status == KILN_OK && round < assignment->rounds; round++) {
        size_t count = 0;
        status = kiln_agree(comm, open_round(w, assignment, w->rank, round, own, &count, error), error);
        if (status == KILN_OK)
            status = gather_round(w, gather, round, error);
        if (status == KILN_OK)
            status = finish(w, assignment, round, own, count, error);
    }
    kiln_free(&own);
    kiln_texel_gather_destroy(&gather);
    return status;
}
