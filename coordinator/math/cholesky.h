/* Cholesky factorization L D L^T of sparse symmetric positive definite matrices that differ on their diagonals only,
 * and solution of their systems. The matrices are processed side by side, each in one lane: the lanes' values are
 * adjacent in memory, and each result is the same as when computed alone.
 *
 * Unknowns are numbered in the order of elimination (elimination.h). A core that this leaves is solved by conjugate
 * gradients with the diagonal as preconditioner, which take few steps for such close unknowns. Columns are computed
 * from left to right, each from the earlier columns with an entry in its row (Davis, "Direct methods for sparse linear
 * systems", 2006, 4.10).
 *
 * CHOLMOD (SuiteSparse 5.12) is not used, because it factors one matrix at a time and adds in another order. Measured
 * simplicial L D L^T of eight matrices from tests/unit/test_cholesky.c, with 50,000 unknowns along a curve and 775
 * thousand entries, in processor time: 0.265 s by CHOLMOD in the same order, 0.137 s in its own (AMD, 23 % fewer
 * entries), 0.053 s here; a solution of each 0.011 s by CHOLMOD and 0.014 s here. 99 % of the values differed in their
 * last bits, by at most 3e-9 of the value. And CHOLMOD has no core: it would fill in the part that conjugate gradients
 * solve here. */
#ifndef KILN_COORDINATOR_MATH_CHOLESKY_H
#define KILN_COORDINATOR_MATH_CHOLESKY_H

#include "coordinator/math/elimination.h"
#include "worker/base/arena.h"

enum { KILN_CHOLESKY_LANES = 8 };

/* Arrays per unknown or entry have `lanes` numbers for each. */
struct kiln_cholesky {
    const struct kiln_elimination *elimination; /* borrowed */
    size_t lanes;
    double *matrix;             /* one number for each entry below the diagonal, the same in all lanes */
    double *diagonal;           /* of the matrices; after factorization D, and the core's diagonal */
    double *entries;            /* of L, and of the core */
    double *column;             /* working memory */
    uint32_t *waiting, *behind; /* linked lists of columns by the next row in which they have an entry */
    size_t *next;               /* for each column, that entry */
    double *core, *residual, *direction, *product; /* vectors of the core; core: last solution, start of the next */
    struct kiln_arena arena;
};

/* The number of lanes for so many matrices: 1, 2, 4, 6 or 8. */
size_t kiln_cholesky_lanes(size_t matrices);

/* Allocates memory. The caller sets `matrix` and `diagonal`. KILN_SYSTEM; can be destroyed then, too. */
int kiln_cholesky_create(struct kiln_cholesky *cholesky, const struct kiln_elimination *elimination, size_t lanes,
                         struct kiln_error *error);
void kiln_cholesky_destroy(struct kiln_cholesky *cholesky);

/* Factorizes the matrices; overwrites `diagonal`. */
void kiln_cholesky_factorize(struct kiln_cholesky *cholesky);
/* Discards the core's last solution, from which the next solve would start. */
void kiln_cholesky_forget(struct kiln_cholesky *cholesky);
/* Solves the systems: replaces the right-hand sides `x` by the solutions. */
void kiln_cholesky_solve(struct kiln_cholesky *cholesky, double *x);

#endif
