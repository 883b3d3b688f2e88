/* Elimination: the order in which the unknowns of a sparse symmetric system are eliminated so that its Cholesky factor
 * stays sparse, and the positions of the factor's entries. The order is by minimum degree, with exact degrees, on the
 * quotient graph of elements (George and Liu, "The evolution of the minimum degree ordering algorithm", 1989). Unknowns
 * that can follow the one before without a further entry do so at once (mass elimination), and share its list of rows.
 *
 * A system is given by its cliques: sets of unknowns used by one row of a least-squares problem, in which each has an
 * entry with all others. If cliques lie along curves on surfaces, as samples at seams do, a column of the factor has
 * some ten entries, and all unknowns are eliminated. If they are so dense that a factor would cost much, unknowns are
 * eliminated only while they have few neighbours. The rest is a core: its columns have the entries of the remaining
 * matrix (a Schur complement). */
#ifndef KILN_COORDINATOR_MATH_ELIMINATION_H
#define KILN_COORDINATOR_MATH_ELIMINATION_H

#include <stddef.h>
#include <stdint.h>

#include "worker/base/arena.h"
#include "worker/base/status.h"

/* Result of the elimination. Columns and rows are numbered in the order of elimination. */
struct kiln_elimination {
    size_t count;      /* of unknowns */
    size_t eliminated; /* unknowns at this and later places are the core */
    uint32_t *place;   /* place of each unknown in the order of elimination */
    size_t *first;     /* start of each column's entries in a factor, and the end; without the diagonal */
    size_t *first_row; /* start of each column's ascending list in `rows`; columns may share lists */
    uint32_t *rows;
    struct kiln_arena arena;
};

/* `cliques` lists `size` unknowns for each of `clique_count` cliques; an unknown may repeat within a clique. Not
 * collective, no other inputs. KILN_SYSTEM; can be destroyed then, too. */
int kiln_elimination_create(struct kiln_elimination *elimination, size_t count, const uint32_t *cliques,
                            size_t clique_count, size_t size, struct kiln_error *error);
void kiln_elimination_destroy(struct kiln_elimination *elimination);

static inline size_t kiln_elimination_entries(const struct kiln_elimination *e) { return e->first[e->count]; }

#endif
