/* What of a rank's work in a pass is still to be had, in memory that the ranks of its node share.
 *
 * Work is a range of the rank's own fragments. The owner takes from its begin, others take from its end; both by
 * compare-and-swap on one 64-bit word, so every fragment is taken once. What others have taken is away until they
 * return it; then its results lie where the owner's own would. Numbers of points, not of fragments, are away and
 * returned.
 *
 * All functions but those marked (owner) may be called by any rank of the node at any time. None waits. */
#ifndef KILN_COORDINATOR_BAKE_BOARD_H
#define KILN_COORDINATOR_BAKE_BOARD_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* s of work in a batch, where the end of a pass makes batches shorter so that others can take the rest */
#define KILN_LEAST_BATCH 0.02

/* A range of a rank's own fragments, below 2^32. */
struct kiln_range {
    size_t first, count;
};

/* All zero: nothing to be had. */
struct kiln_board {
    _Atomic uint64_t left;     /* first fragment, and 2^32 times the end */
    _Atomic uint64_t away;     /* points */
    _Atomic uint64_t returned; /* points */
    _Atomic uint64_t speed;    /* points a second */
};

/* (owner) A pass begins: nothing is returned yet, and nothing to be had. Nothing may be away. */
void kiln_board_begin(struct kiln_board *board);
/* (owner) A range that may be taken from, once the one before is gone. */
void kiln_board_open(struct kiln_board *board, struct kiln_range range);
/* What is left of it. */
struct kiln_range kiln_board_left(const struct kiln_board *board);

/* (owner) Takes the first `count` fragments of what was `seen` to be left; false when that has changed. */
bool kiln_board_take(struct kiln_board *board, struct kiln_range seen, size_t count);
/* Takes the last `count`, which hold `points`, likewise. */
bool kiln_board_take_away(struct kiln_board *board, struct kiln_range seen, size_t count, uint64_t points);
/* Their results are in place. */
void kiln_board_return(struct kiln_board *board, uint64_t points);

uint64_t kiln_board_away(const struct kiln_board *board);
uint64_t kiln_board_returned(const struct kiln_board *board); /* in this pass */

/* How fast the owner works, for others to judge who is behind; at least one point a second. */
void kiln_board_set_speed(struct kiln_board *board, double points_a_second);
double kiln_board_speed(const struct kiln_board *board);

#endif
