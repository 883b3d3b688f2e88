#include "coordinator/bake/light/reference_radius.h"

#include <math.h>

#include "coordinator/mpi/agree.h"
#include "worker/base/memory.h"

enum { STEPS = 8, OCTAVES = 128, BINS = STEPS * OCTAVES }; /* of widths, from 2^-64 m on */

static size_t bin_of(float area)
{
    const double at = rint(STEPS * (0.5 * log2((double)area) + OCTAVES / 2));
    return at < 0.0 ? 0 : at >= BINS ? BINS - 1 : (size_t)at;
}

/* Returns the bin of the median: the first one up to whose end at least half of all entries lie. BINS: there are no
 * entries. */
static size_t median_of(const uint64_t counts[BINS])
{
    uint64_t all = 0, below = 0;
    for (size_t i = 0; i < BINS; i++)
        all += counts[i];
    for (size_t i = 0; i < BINS; i++) {
        below += counts[i];
        if (all > 0 && 2 * below >= all)
            return i;
    }
    return BINS;
}

int kiln_median_texel(const struct kiln_surface *surface, MPI_Comm communicator, double *width,
                      struct kiln_error *error)
{
    uint64_t *counts = NULL;
    const int status =
        kiln_agree(communicator, kiln_allocate(&counts, BINS, sizeof *counts, "widths of texels", error), error);
    *width = 0.0;
    if (status == KILN_OK) {
        for (uint64_t i = 0; i < surface->count; i++)
            if (surface->area[i] > 0.0f)
                counts[bin_of(surface->area[i])]++;
        (void)MPI_Allreduce(MPI_IN_PLACE, counts, BINS, MPI_UINT64_T, MPI_SUM, communicator);
        const size_t median = median_of(counts);
        *width = median < BINS ? exp2((double)median / STEPS - OCTAVES / 2) : 0.0;
    }
    kiln_free(&counts);
    return status;
}
