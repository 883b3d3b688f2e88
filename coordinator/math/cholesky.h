/* Cholesky: the factors L D L^T of sparse symmetric positive definite matrices that differ on their diagonals only, and
 * the solutions of their systems. They are computed side by side: values of all matrices stand next to one another, one
 * in each lane, and each is what it is alone.
 *
 * Unknowns are numbered in the order of elimination (elimination.h). If that leaves a core, it is solved by conjugate
 * gradients with the diagonal as preconditioner, which take few steps where all is close together. Columns are computed
 * from left to right, each from those before that have an entry in its row (Davis, "Direct methods for sparse linear
 * systems", 2006, 4.10).
 *
 * CHOLMOD (SuiteSparse 5.12) is not used, because it factors one matrix at a time and adds in another order. Simplicial
 * L D L^T of eight matrices as tests/unit/test_cholesky.c makes them, of 50,000 unknowns along a curve and 775 thousand
 * entries, by processor time: 0.265 s by CHOLMOD in the same order, 0.137 s in its own (AMD, 23 % fewer entries), 0.053
 * s here; a solution of each 0.011 s by CHOLMOD and 0.014 s here. 99 % of the values differed in their last bits, by
 * 3e-9 of the value at most. And it has no core: what this leaves to conjugate gradients it would fill in. */
#ifndef KILN_COORDINATOR_MATH_CHOLESKY_H
#define KILN_COORDINATOR_MATH_CHOLESKY_H

#include "coordinator/math/elimination.h"
#include "worker/base/arena.h"

enum { KILN_CHOLESKY_LANES = 8 };

/* Arrays for each unknown or entry have `lanes` numbers for each. */
struct kiln_cholesky {
    const struct kiln_elimination *elimination; /* borrowed */
    size_t lanes;
    double *matrix;             /* one number for each entry below the diagonal, the same in all lanes */
    double *diagonal;           /* of the matrices; then D, and the core's */
    double *entries;            /* of L, and of the core */
    double *column;             /* working memory */
    uint32_t *waiting, *behind; /* columns by the next row that they have an entry in, as lists */
    size_t *next;               /* that entry of each column */
    double *core, *residual, *direction, *product; /* of the core; core: its solution, with which the next one begins */
    struct kiln_arena arena;
};

/* The number of lanes for so many matrices: 1, 2, 4, 6 or 8. */
size_t kiln_cholesky_lanes(size_t matrices);

/* The caller sets `matrix` and `diagonal`. KILN_SYSTEM; can be destroyed then, too. */
int kiln_cholesky_create(struct kiln_cholesky *cholesky, const struct kiln_elimination *elimination, size_t lanes,
                         struct kiln_error *error);
void kiln_cholesky_destroy(struct kiln_cholesky *cholesky);

/* Replaces `diagonal`. */
void kiln_cholesky_factorize(struct kiln_cholesky *cholesky);
/* Forgets the solution that the next one would begin with, if there is a core. */
void kiln_cholesky_forget(struct kiln_cholesky *cholesky);
/* Replaces the right sides by the solutions. */
void kiln_cholesky_solve(struct kiln_cholesky *cholesky, double *x);

#endif
