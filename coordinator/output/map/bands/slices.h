/* Slices: a range of numbers, one part for each thread. What a slice has is counted first; then every slice is written
 * at the same time as the others, where those before it end. So the order is that of the numbers, for any number of
 * threads. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_BANDS_SLICES_H
#define KILN_COORDINATOR_OUTPUT_MAP_BANDS_SLICES_H

#include <omp.h>
#include <stddef.h>

/* Number of slices for so many numbers: one for each thread, but none of less than some thousand numbers. */
static inline int kiln_slices(size_t count)
{
    enum { ENOUGH = 1 << 13 };
    const size_t most = count / ENOUGH + 1, threads = (size_t)omp_get_max_threads();
    return (int)(threads < most ? threads : most);
}

/* The slice [*begin, *end) of so many. */
static inline void kiln_slice(int slices, int slice, size_t count, size_t *begin, size_t *end)
{
    *begin = count * (size_t)slice / (size_t)slices;
    *end = count * ((size_t)slice + 1) / (size_t)slices;
}

#endif
