/* Elimination: in which order the unknowns of a sparse symmetric system are eliminated so that its Cholesky factor
 * stays sparse, and where that factor has entries. The order is by minimum degree, with exact degrees, on the quotient
 * graph of elements (George and Liu, "The evolution of the minimum degree ordering algorithm", 1989); unknowns that can
 * follow the one before without a further entry do so at once (mass elimination), and share its list of rows.
 *
 * A system is given by its cliques: the sets of unknowns that one row of a least-squares problem reads, each of which
 * has an entry with all others. Where such sets lie along curves on surfaces, as samples at seams do, a column of the
 * factor has some ten entries, and all unknowns are eliminated. Where they lie so close together that a factor would be
 * much work, unknowns are eliminated as long as they have few neighbours. The rest is a core: its columns have the
 * entries of the matrix that is left (a Schur complement). */
#ifndef KILN_COORDINATOR_MATH_ELIMINATION_H
#define KILN_COORDINATOR_MATH_ELIMINATION_H

#include <stddef.h>
#include <stdint.h>

#include "worker/base/arena.h"
#include "worker/base/status.h"

/* Columns and rows are numbers in the order of elimination. */
struct kiln_elimination {
    size_t count;      /* of unknowns */
    size_t eliminated; /* those with places from here on are the core */
    uint32_t *place;   /* of each unknown in the order of elimination */
    size_t *first;     /* of each column's entries in a factor, and the end; the diagonal is not among them */
    size_t *first_row; /* of each column in `rows`, rising; columns may share them */
    uint32_t *rows;
    struct kiln_arena arena;
};

/* `cliques` lists `size` unknowns for each of `clique_count` cliques; one unknown may occur several times there. Not
 * collective; depends on nothing else. KILN_SYSTEM; can be destroyed then, too. */
int kiln_elimination_create(struct kiln_elimination *elimination, size_t count, const uint32_t *cliques,
                            size_t clique_count, size_t size, struct kiln_error *error);
void kiln_elimination_destroy(struct kiln_elimination *elimination);

static inline size_t kiln_elimination_entries(const struct kiln_elimination *e) { return e->first[e->count]; }

#endif
