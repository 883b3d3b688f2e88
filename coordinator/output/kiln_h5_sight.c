#include "coordinator/output/kiln_h5_sight.h"

#include <stdlib.h>

#include "coordinator/mpi/agree.h"
#include "worker/base/memory.h"

enum { PIECE = 1 << 24 }; /* pairs in a message */

static int compare(const void *a, const void *b)
{
    const uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;
    return x < y ? -1 : x > y ? 1 : 0;
}

/* Sorts the pairs and removes duplicates: ranks that share a unit all have its pairs. */
static void sort_pairs(struct kiln_h5_sight *s)
{
    size_t kept = 0;
    qsort(s->pairs, s->count, sizeof *s->pairs, compare);
    for (size_t i = 0; i < s->count; i++)
        if (kept == 0 || s->pairs[kept - 1] != s->pairs[i])
            s->pairs[kept++] = s->pairs[i];
    s->count = kept;
}

static void send_pairs(const struct kiln_bake_result *result)
{
    for (uint64_t at = 0, some; at < result->sight_pair_count; at += some) {
        some = result->sight_pair_count - at < PIECE ? result->sight_pair_count - at : PIECE;
        (void)MPI_Send(result->sight_pairs + at, (int)some, MPI_UINT64_T, 0, 0, result->communicator);
    }
}

static void receive_pairs(struct kiln_h5_sight *s, const uint64_t *counts, int ranks, MPI_Comm communicator)
{
    for (int r = 1; r < ranks; r++)
        for (uint64_t at = 0, some; at < counts[r]; at += some) {
            some = counts[r] - at < PIECE ? counts[r] - at : PIECE;
            (void)MPI_Recv(s->pairs + s->count, (int)some, MPI_UINT64_T, r, 0, communicator, MPI_STATUS_IGNORE);
            s->count += (size_t)some;
        }
}

int kiln_h5_sight_gather(struct kiln_h5_sight *sight, const struct kiln_bake_result *result, struct kiln_error *error)
{
    uint64_t *counts = NULL, total = 0;
    const uint64_t own = result->sight_pair_count;
    int rank, ranks;
    *sight = (struct kiln_h5_sight){0};
    if (result->sight_units == 0)
        return KILN_OK;
    (void)MPI_Comm_rank(result->communicator, &rank);
    (void)MPI_Comm_size(result->communicator, &ranks);
    int status = kiln_allocate(&counts, (size_t)ranks, sizeof *counts, "the visibility grid", error);
    status = kiln_agree(result->communicator, status, error);
    if (status == KILN_OK)
        (void)MPI_Gather(&own, 1, MPI_UINT64_T, counts, 1, MPI_UINT64_T, 0, result->communicator);
    for (int r = 0; status == KILN_OK && rank == 0 && r < ranks; r++)
        total += counts[r];
    if (status == KILN_OK) {
        status = kiln_allocate(&sight->pairs, (size_t)total, sizeof *sight->pairs, "the visibility grid", error);
        status = kiln_agree(result->communicator, status, error);
    }
    if (status == KILN_OK && rank == 0) {
        for (uint64_t i = 0; i < own; i++)
            sight->pairs[sight->count++] = result->sight_pairs[i];
        receive_pairs(sight, counts, ranks, result->communicator);
        sort_pairs(sight);
    } else if (status == KILN_OK) {
        send_pairs(result);
    }
    kiln_free(&counts);
    return status;
}

void kiln_h5_sight_release(struct kiln_h5_sight *sight) { kiln_free(&sight->pairs); }

uint64_t kiln_h5_sight_space(const struct kiln_bake_result *result)
{
    uint64_t pairs = result->sight_pair_count;
    (void)MPI_Allreduce(MPI_IN_PLACE, &pairs, 1, MPI_UINT64_T, MPI_SUM, result->communicator);
    return result->sight_units > 0 ? 16 * (result->sight_units + 1) + 4 * pairs + 4096 : 0;
}

/* Splits the pairs into arrays: the start of each unit's list, and the lists. */
static int split_pairs(const struct kiln_h5_sight *s, uint64_t units, uint64_t **first, uint32_t **seen,
                       struct kiln_error *error)
{
    int status;
    KILN_TRY(kiln_allocate(first, (size_t)units + 1, sizeof **first, "the visibility grid", error));
    KILN_TRY(kiln_allocate(seen, s->count, sizeof **seen, "the visibility grid", error));
    for (size_t i = 0; i < s->count; i++) {
        (*first)[(s->pairs[i] >> 32) + 1]++;
        (*seen)[i] = (uint32_t)s->pairs[i];
    }
    for (uint64_t u = 0; u < units; u++)
        (*first)[u + 1] += (*first)[u];
end:
    return status;
}

int kiln_h5_sight_write(struct kiln_h5 *h5, const struct kiln_h5_sight *sight, const struct kiln_bake_result *result,
                        struct kiln_error *error)
{
    uint64_t *first = NULL;
    uint32_t *seen = NULL;
    if (result->sight_units == 0)
        return KILN_OK;
    const struct kiln_h5_dataset points = {
        .name = "/visibility/point",
        .type = H5T_NATIVE_UINT64,
        .rank = 1,
        .size = {result->sight_units},
        .units = "1",
        .description = "index in /points of the first point of each patch: consecutive points of one cell, or without "
                       "cells of one side of an object, up to the first of the next patch"};
    const struct kiln_h5_dataset firsts = {
        .name = "/visibility/first",
        .type = H5T_NATIVE_UINT64,
        .rank = 1,
        .size = {result->sight_units + 1},
        .units = "1",
        .description = "where the list of each patch begins in /visibility/seen, and the length of that at the end"};
    const struct kiln_h5_dataset lists = {
        .name = "/visibility/seen",
        .type = H5T_NATIVE_UINT32,
        .rank = 1,
        .size = {sight->count},
        .units = "1",
        .description = "the patches that rays from points of the patch have met, or whose rays have met it, "
                       "ascending: sampled, so that some that are seen little are missing"};
    int status;
    KILN_TRY(split_pairs(sight, result->sight_units, &first, &seen, error));
    KILN_TRY(kiln_h5_group(h5, "/visibility", error));
    KILN_TRY(kiln_h5_small(h5, &points, result->sight_first, error));
    KILN_TRY(kiln_h5_small(h5, &firsts, first, error));
    KILN_TRY(kiln_h5_small(h5, &lists, seen, error));
end:
    kiln_free(&first);
    kiln_free(&seen);
    return status;
}
