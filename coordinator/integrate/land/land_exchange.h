/* Exchange of landings of light paths: records that are sent to the owners of their surface points, and the sums of
 * each point. It handles one block of paths at a time (land.h). If all ranks are on one node nothing is sent: records
 * are in shared memory, sorted by stretches of points, and the owner of a stretch reads its records of all ranks. */
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
    uint32_t point; /* index among the points of the owning rank */
    float flux[3];  /* W */
    float shading, taken_up;
    float others; /* of struct kiln_land_result */
    uint32_t aim;
};

/* Data for weighting landings, if gather rays find a part of the light (kiln_caustic_weight_landed). */
struct kiln_landing_weights {
    enum kiln_mis mis;
    double rays;       /* of a point */
    const float *area; /* m2, of own points: kiln_lit_area */
};

/* Sum of the light of paths so far at an own point, W. Stored in checkpoints. */
struct kiln_landing_sum {
    double irradiance[3], incident[3];
    double square;  /* sum of the squared luminances of irradiance, W2 */
    uint64_t count; /* of paths */
};

/* State of the exchange. Rank r owns the points from first[r] on, before first[r + 1]. */
struct kiln_land_exchange {
    MPI_Comm communicator;
    int rank, ranks;
    uint64_t *first;                     /* ranks + 1 */
    uint64_t *stretch;                   /* ranks + 1: number of the first stretch of a rank, counted over all ranks */
    struct kiln_exchange exchange;       /* of records that are sent */
    struct kiln_node_memory *node;       /* the node, if it has all ranks */
    struct kiln_rank_regions *parts;     /* parts of its ranks, in order; NULL: records are sent */
    struct kiln_landing_record *records; /* records of the block, in path order; in the own part */
    uint32_t *bin_of; /* for each record: the rank that owns its point, if it is to be sent; else the stretch */
    int shift;        /* 2^shift points are a stretch */
    size_t count, room, bin_room;
    struct kiln_landing_record *sent; /* by rank */
    size_t sent_room;
    struct kiln_bins sorted;
    uint32_t threads;
    const struct kiln_landing_weights *weights; /* borrowed; NULL: landings count whole */
};

/* A list of landings on own points, in the order of their paths. */
struct kiln_landing_list {
    const struct kiln_landing_record *records;
    const uint32_t *which; /* indices into `records`; NULL: the first `count` */
    size_t count;
};
/* Gets landing i and prefetches a later one, since records of a list are far apart in memory. */
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

/* Callback for landings on own points. Called by several threads at once, but for each point by one of them only. */
typedef void (*kiln_take_landings)(void *context, const struct kiln_landing_list *list);

/* Collective. This rank has the points [first, first + count), ranks in order; a batch has `paths` at most, of which
 * each rank has an equal part. `node`: of which the rank is; where all ranks are of it they share memory for their
 * records, unless there is none. NULL: they do not. `limit`: of a message (mpi/exchange.h). KILN_SYSTEM; KILN_USAGE on
 * all ranks where one has 2^32 points or more. Release with kiln_land_exchange_release, in any case. */
int kiln_land_exchange_create(struct kiln_land_exchange *exchange, MPI_Comm communicator, struct kiln_node_memory *node,
                              uint64_t first, uint64_t count, uint64_t paths, uint64_t limit, struct kiln_error *error);
void kiln_land_exchange_release(struct kiln_land_exchange *exchange);

/* Makes room for `more` further records; a block has at most as many records as this rank's part has paths.
 * KILN_SYSTEM. */
int kiln_land_exchange_grow(struct kiln_land_exchange *exchange, size_t more, struct kiln_error *error);
/* Gets record number `at` of the block, within the room, and sets its point from the global number; the caller fills in
 * the rest. Thread-safe for different `at`. The caller increases `count`. */
struct kiln_landing_record *kiln_land_exchange_put(struct kiln_land_exchange *exchange, size_t at, uint64_t point);
/* Collective. Sends the records of this rank, which are in the order of their paths, to the owners of their points, and
 * passes received records to `take`. Each point's records come in the order of their paths: a rank's paths precede
 * those of the next rank. No record is left afterwards. All ranks together may have at most 2^31 - 1 records in a
 * block. KILN_SYSTEM on all ranks. */
int kiln_land_exchange(struct kiln_land_exchange *exchange, kiln_take_landings take, void *context,
                       struct kiln_error *error);

/* The weight of a landing on an own point. */
double kiln_land_weight(const struct kiln_land_exchange *exchange, const struct kiln_landing_record *record);
/* Adds a landing to the sum of its point. */
void kiln_land_add(const struct kiln_landing_record *record, double weight, struct kiln_landing_sum *sum);

#endif
