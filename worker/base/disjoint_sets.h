/* Disjoint sets (union-find) of the numbers 0 .. n - 1, with path halving (Tarjan, "Efficiency of a Good But Not Linear
 * Set Union Algorithm", 1975). `parent` has n entries; a root is its own parent and the least number of its set. So
 * numbering by roots does not depend on the order of unions. Not thread-safe. */
#ifndef KILN_WORKER_BASE_DISJOINT_SETS_H
#define KILN_WORKER_BASE_DISJOINT_SETS_H

#include <stddef.h>
#include <stdint.h>

/* Makes each number a set of its own. */
static inline void kiln_sets_begin(uint32_t *parent, size_t count)
{
    for (size_t i = 0; i < count; i++)
        parent[i] = (uint32_t)i;
}

static inline uint32_t kiln_sets_root(uint32_t *parent, uint32_t i)
{
    while (parent[i] != i) {
        parent[i] = parent[parent[i]];
        i = parent[i];
    }
    return i;
}

/* Unites the sets of a and b. */
static inline void kiln_sets_join(uint32_t *parent, uint32_t a, uint32_t b)
{
    a = kiln_sets_root(parent, a);
    b = kiln_sets_root(parent, b);
    if (a < b)
        parent[b] = a;
    else
        parent[a] = b;
}

#endif
