/* Slices: a range of indices divided among threads. A first pass counts each slice's output; then all slices are
 * written at once, each after the end of those before it. So the output is in the order of the indices, for any number
 * of threads. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_BANDS_SLICES_H
#define KILN_COORDINATOR_OUTPUT_MAP_BANDS_SLICES_H

#include <omp.h>
#include <stddef.h>

/* Number of slices for `count` indices: one for each thread, but each with at least some thousand indices. */
static inline int kiln_slices(size_t count)
{
    enum { ENOUGH = 1 << 13 };
    const size_t most = count / ENOUGH + 1, threads = (size_t)omp_get_max_threads();
    return (int)(threads < most ? threads : most);
}

/* Computes the bounds [*begin, *end) of a slice. */
static inline void kiln_slice(int slices, int slice, size_t count, size_t *begin, size_t *end)
{
    *begin = count * (size_t)slice / (size_t)slices;
    *end = count * ((size_t)slice + 1) / (size_t)slices;
}

#endif
