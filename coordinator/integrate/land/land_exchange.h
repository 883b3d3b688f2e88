/* Landings of light paths: what travels of each to the rank that has its surface point, and the sums over a point's.
 * One block of paths at a time (land.h). Where all ranks are of one node nothing travels: their records lie in memory
 * that they share, sorted by stretches of points, and the rank that has a stretch reads those of all. */
#ifndef KILN_COORDINATOR_INTEGRATE_LAND_LAND_EXCHANGE_H
#define KILN_COORDINATOR_INTEGRATE_LAND_LAND_EXCHANGE_H

#include <mpi.h>
#include <stddef.h>
#include <stdint.h>

#include "coordinator/integrate/land/bins.h"
#include "coordinator/mpi/exchange.h"
#include "coordinator/mpi/node_memory.h"
#include "worker/base/status.h"
#include "worker/pass/caustic_weights.h"

/* 32 bytes. */
struct kiln_landing_record {
    uint32_t point; /* number among those of the rank that has it */
    float flux[3];  /* W */
    float shading, taken_up;
    float others; /* of struct kiln_land_result */
    uint32_t aim;
};

/* Where gather rays find a part of the light: what landings are weighed by (kiln_caustic_weight_landed). */
struct kiln_landing_weights {
    enum kiln_mis mis;
    double rays;       /* of a point */
    const float *area; /* m2, of own points: kiln_lit_area */
};

/* Light from paths so far at an own point, W. Lies in checkpoints. */
struct kiln_landing_sum {
    double irradiance[3], incident[3];
    double square;  /* of the luminances of irradiance, W2 */
    uint64_t count; /* of paths */
};

/* Which rank has which points: rank r has those from first[r] on, before first[r + 1]. */
struct kiln_land_exchange {
    MPI_Comm communicator;
    int rank, ranks;
    uint64_t *first;                     /* ranks + 1 */
    uint64_t *stretch;                   /* ranks + 1: number of the first stretch of a rank's points among all */
    struct kiln_exchange exchange;       /* of records that are sent */
    struct kiln_node_memory *node;       /* of all ranks, */
    struct kiln_node_parts *parts;       /* and their parts in their order; NULL: records are sent */
    struct kiln_landing_record *records; /* of the block, in the order of their paths; lie in the own part */
    uint32_t *bin_of; /* of each the rank that has its point, if it is to be sent; else the stretch */
    int shift;        /* 2^shift points are a stretch */
    size_t count, room, bin_room;
    struct kiln_landing_record *sent; /* by rank */
    size_t sent_room;
    struct kiln_bins sorted;
    uint32_t threads;
    const struct kiln_landing_weights *weights; /* borrowed; NULL: landings count whole */
};

/* Some landings on own points, in the order of their paths. */
struct kiln_landing_list {
    const struct kiln_landing_record *records;
    const uint32_t *which; /* of the records; NULL: the first ones */
    size_t count;
};
/* Fetches ahead: records of a list lie far from each other. */
static inline const struct kiln_landing_record *kiln_landing_of(const struct kiln_landing_list *list, size_t i)
{
    enum { AHEAD = 24 };
    if (list->which == NULL)
        return &list->records[i];
    if (i + AHEAD < list->count)
        __builtin_prefetch(&list->records[list->which[i + AHEAD]]);
    return &list->records[list->which[i]];
}
/* Prefetches the sum of a landing some places after number `i`. Sums lie even farther apart in memory than records. */
static inline void kiln_landing_fetch_sum(const struct kiln_landing_list *list, size_t i,
                                          const struct kiln_landing_sum *sums)
{
    enum { AHEAD = 12 }; /* its record is fetched by then */
    if (i + AHEAD < list->count)
        __builtin_prefetch(&sums[list->records[list->which == NULL ? i + AHEAD : list->which[i + AHEAD]].point], 1);
}

/* Takes the landings on own points. Called by several threads at once, for one point by one of them. */
typedef void (*kiln_take_landings)(void *context, const struct kiln_landing_list *list);

/* Collective. This rank has the points [first, first + count), ranks in order; a block has `paths` at most, of which
 * each rank has an equal part. `node`: of which the rank is; where all ranks are of it they share memory for their
 * records, unless there is none. NULL: they do not. `limit`: of a message (mpi/exchange.h). KILN_SYSTEM; KILN_USAGE on
 * all ranks where one has 2^32 points or more. Release with kiln_land_exchange_release, in any case. */
int kiln_land_exchange_create(struct kiln_land_exchange *exchange, MPI_Comm communicator, struct kiln_node_memory *node,
                              uint64_t first, uint64_t count, uint64_t paths, uint64_t limit, struct kiln_error *error);
void kiln_land_exchange_release(struct kiln_land_exchange *exchange);

/* Makes room for so many records more; in a block no more than this rank's part has paths. KILN_SYSTEM. */
int kiln_land_exchange_grow(struct kiln_land_exchange *exchange, size_t more, struct kiln_error *error);
/* A record where there is room, number `at` of the block, for a point by its global number; the caller fills in the
 * rest. Several threads may, each at places of its own; `count` is the caller's to raise. */
struct kiln_landing_record *kiln_land_exchange_put(struct kiln_land_exchange *exchange, size_t at, uint64_t point);
/* Collective. Brings the records of this rank, which are in the order of their paths, to the owners of their points,
 * and gives those that come to `take`, each point's in the order of their paths: a rank's paths come before those of
 * the next one. No record is left afterwards. The ranks' records of a block must be 2^31 - 1 at most, all together.
 * KILN_SYSTEM on all ranks. */
int kiln_land_exchange(struct kiln_land_exchange *exchange, kiln_take_landings take, void *context,
                       struct kiln_error *error);

/* The weight of a landing on an own point. */
double kiln_land_weight(const struct kiln_land_exchange *exchange, const struct kiln_landing_record *record);
/* Adds a landing to the sum of its point. */
void kiln_land_add(const struct kiln_landing_record *record, double weight, struct kiln_landing_sum *sum);

#endif
