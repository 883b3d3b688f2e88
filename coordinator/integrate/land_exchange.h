/* Landings of light paths: what travels of each to the rank that has its surface point, and the sums over a point's.
 * One block of paths at a time (land.h). */
#ifndef KILN_COORDINATOR_INTEGRATE_LAND_EXCHANGE_H
#define KILN_COORDINATOR_INTEGRATE_LAND_EXCHANGE_H

#include <mpi.h>
#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"
#include "worker/pass/caustic_weights.h"

/* 40 bytes. */
struct kiln_landing_record {
    uint64_t point; /* global number */
    uint32_t path;  /* number in its block */
    float flux[3];  /* W */
    float shading, taken_up;
    float others; /* of struct kiln_land_result */
    union {
        uint32_t aim;
        float sampled; /* where the weights have factors */
    };
};

/* Where gather rays find a part of the light: what landings are weighed by (kiln_caustic_weight_landed). */
struct kiln_landing_weights {
    enum kiln_mis mis;
    double rays;       /* of a point */
    const float *area; /* m2, of own points: kiln_lit_area */
    /* of struct kiln_caustic_techniques */
    const struct kiln_caustic_factors *factors;
    const uint32_t *region_of;
};

/* What paths so far have brought to an own point, W. Lies in checkpoints. */
struct kiln_landing_sum {
    double irradiance[3], incident[3];
    double square;  /* of the luminances of irradiance, W2 */
    uint64_t count; /* of paths */
};

/* Which rank has which points: rank r has those from first[r] on, before first[r + 1]. */
struct kiln_land_exchange {
    MPI_Comm communicator;
    int rank, ranks;
    uint64_t *first; /* ranks + 1 */
    int *counts;     /* 4 x ranks: records sent to each rank, their places, and the same received */
    struct kiln_landing_record *received;
    size_t room;
    uint32_t threads;                           /* that take landings; 0: one */
    const struct kiln_landing_weights *weights; /* borrowed; NULL: landings count whole */
};

/* What is done with the landings on own points: of each record, and its weight. Called by several threads at once, for
 * one point by one of them. */
typedef void (*kiln_take_landing)(void *context, const struct kiln_landing_record *record, double weight);

/* Collective. This rank has the points [first, first + count), ranks in order. KILN_SYSTEM. Release with
 * kiln_land_exchange_release, in any case. */
int kiln_land_exchange_create(struct kiln_land_exchange *exchange, MPI_Comm communicator, uint64_t first,
                              uint64_t count, struct kiln_error *error);
void kiln_land_exchange_release(struct kiln_land_exchange *exchange);

/* Collective. Sends `count` records of this rank, which are in the order of their paths, to the owners of their points,
 * and gives those that come to `take`, each point's in the order of their paths: a rank's paths come before those of
 * the next one. kiln_land_add adds them to the sums of own points. Beside other ranks sorts `records`. The ranks'
 * records of a block must be 2^31 - 1 at most, all together. KILN_SYSTEM on all ranks. */
int kiln_land_exchange(struct kiln_land_exchange *exchange, struct kiln_landing_record *records, size_t count,
                       kiln_take_landing take, void *context, struct kiln_error *error);

/* Adds a landing to the sum of its point. */
void kiln_land_add(const struct kiln_landing_record *record, double weight, struct kiln_landing_sum *sum);

#endif
