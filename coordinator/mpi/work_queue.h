/* Work-stealing queue: the tile runs that a rank has still to compute in a pass, in memory that the ranks of its node
 * share.
 *
 * Each rank owns one queue. It holds a range of the rank's own tile runs. The owner takes tile runs from the front of
 * the range, other ranks (thieves) steal them from its back. Both do so by compare-and-swap on one 64-bit word, so each
 * tile run is taken once. A thief writes its results where the owner would have written them and then returns the work.
 * The queue counts the points that are stolen and not yet returned, and those returned in this pass.
 *
 * Functions marked (owner) are for the owning rank only. The others may be called by any rank of the node at any time.
 * None of them waits. */
#ifndef KILN_COORDINATOR_MPI_WORK_QUEUE_H
#define KILN_COORDINATOR_MPI_WORK_QUEUE_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Shortest batch, in seconds of work. Towards the end of a pass batches get shorter, so that other ranks can steal. */
#define KILN_LEAST_BATCH 0.02

/* A range of a rank's own tile runs. Indices are below 2^32. */
struct kiln_range {
    size_t first, count;
};

/* All zero: the queue is empty. */
struct kiln_work_queue {
    _Atomic uint64_t left;     /* the range that is left: its first tile run + 2^32 times its end */
    _Atomic uint64_t away;     /* points that are stolen and not yet returned */
    _Atomic uint64_t returned; /* points that thieves have returned in this pass */
    _Atomic uint64_t speed;    /* of the owner, points a second */
};

/* (owner) Empties the queue and its counters at the begin of a pass. No stolen work may be outstanding. */
void kiln_work_queue_begin(struct kiln_work_queue *queue);
/* (owner) Puts a range into the queue, which must be empty. */
void kiln_work_queue_open(struct kiln_work_queue *queue, struct kiln_range range);
/* The range that is left. */
struct kiln_range kiln_work_queue_left(const struct kiln_work_queue *queue);

/* (owner) Takes the first `count` tile runs. `seen` is what kiln_work_queue_left returned; false, and nothing taken,
 * when the queue has changed since. */
bool kiln_work_queue_take(struct kiln_work_queue *queue, struct kiln_range seen, size_t count);
/* Steals the last `count` tile runs, which have `points` points, in the same way. */
bool kiln_work_queue_steal(struct kiln_work_queue *queue, struct kiln_range seen, size_t count, uint64_t points);
/* Returns stolen work of `points` points: its results have been written. */
void kiln_work_queue_return(struct kiln_work_queue *queue, uint64_t points);

/* Points that are stolen and not yet returned. */
uint64_t kiln_work_queue_away(const struct kiln_work_queue *queue);
/* Points that were stolen and returned in this pass. */
uint64_t kiln_work_queue_returned(const struct kiln_work_queue *queue);

/* The speed of the owner, at least one point a second. Thieves use it to choose the queue that would last longest. */
void kiln_work_queue_set_speed(struct kiln_work_queue *queue, double points_a_second);
double kiln_work_queue_speed(const struct kiln_work_queue *queue);

#endif
