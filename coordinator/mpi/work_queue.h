/* What of a rank's work in a pass is still to be had, in memory that the ranks of its node share.
 *
 * Work is a range of the rank's own tile runs. The owner takes from its begin, others take from its end; both by
 * compare-and-swap on one 64-bit word, so every tile run is taken once. What others have taken is away until they
 * return it; then its results lie where the owner's own would. Numbers of points, not of tile runs, are away and
 * returned.
 *
 * All functions but those marked (owner) may be called by any rank of the node at any time. None waits. */
#ifndef KILN_COORDINATOR_MPI_WORK_QUEUE_H
#define KILN_COORDINATOR_MPI_WORK_QUEUE_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* s of work in a batch, where the end of a pass makes batches shorter so that others can take the rest */
#define KILN_LEAST_BATCH 0.02

/* A range of a rank's own tile runs, below 2^32. */
struct kiln_range {
    size_t first, count;
};

/* All zero: nothing to be had. */
struct kiln_work_queue {
    _Atomic uint64_t left;     /* first tile run, and 2^32 times the end */
    _Atomic uint64_t away;     /* points */
    _Atomic uint64_t returned; /* points */
    _Atomic uint64_t speed;    /* points a second */
};

/* (owner) A pass begins: nothing is returned yet, and nothing to be had. Nothing may be away. */
void kiln_work_queue_begin(struct kiln_work_queue *queue);
/* (owner) A range that may be taken from, once the one before is gone. */
void kiln_work_queue_open(struct kiln_work_queue *queue, struct kiln_range range);
/* What is left of it. */
struct kiln_range kiln_work_queue_left(const struct kiln_work_queue *queue);

/* (owner) Takes the first `count` tile runs of what was `seen` to be left; false when that has changed. */
bool kiln_work_queue_take(struct kiln_work_queue *queue, struct kiln_range seen, size_t count);
/* Takes the last `count`, which hold `points`, likewise. */
bool kiln_work_queue_steal(struct kiln_work_queue *queue, struct kiln_range seen, size_t count, uint64_t points);
/* Their results are in place. */
void kiln_work_queue_return(struct kiln_work_queue *queue, uint64_t points);

uint64_t kiln_work_queue_away(const struct kiln_work_queue *queue);
uint64_t kiln_work_queue_returned(const struct kiln_work_queue *queue); /* in this pass */

/* How fast the owner works, for others to judge who is behind; at least one point a second. */
void kiln_work_queue_set_speed(struct kiln_work_queue *queue, double points_a_second);
double kiln_work_queue_speed(const struct kiln_work_queue *queue);

#endif
