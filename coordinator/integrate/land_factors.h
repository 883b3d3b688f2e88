/* Factors by which techniques that find caustics count, and exchanges between them (--mis variance, correlation and
 * optimal, worker/pass/weighed.h), one set a region: some tiles that are next to each other in the list of all, the
 * same on all ranks whoever has their points.
 *
 * The moments of a region's points are summed up in whole numbers, of which the largest moment of a point of the region
 * is 2^32: the same sums for any ranks, threads and order. */
#ifndef KILN_COORDINATOR_INTEGRATE_LAND_FACTORS_H
#define KILN_COORDINATOR_INTEGRATE_LAND_FACTORS_H

#include <mpi.h>

#include "worker/base/status.h"
#include "worker/pass/weighed.h"
#include "worker/scene/surface.h"

/* No factor is more than this, or less than one over it. */
#define KILN_LAND_FACTOR_MOST 16.0

struct kiln_land_factors {
    size_t regions;
    struct kiln_caustic_factors *of; /* a region; 1 until they are found */
    uint32_t *region_of;             /* an own point */
};

/* Not collective. Of the surface's own points. Zero before; release with kiln_land_factors_release, in any case.
 * KILN_SYSTEM. */
int kiln_land_factors_create(struct kiln_land_factors *factors, const struct kiln_surface *surface,
                             struct kiln_error *error);
void kiln_land_factors_release(struct kiln_land_factors *factors);

/* Collective. Finds the factors from the moments of own points. KILN_SYSTEM on all ranks. */
int kiln_land_factors_find(struct kiln_land_factors *factors, MPI_Comm communicator, enum kiln_mis mis,
                           const struct kiln_caustic_moments *moments, const struct kiln_surface *surface,
                           struct kiln_error *error);

/* Whether factors from a checkpoint may be what kiln_land_factors_find has made. */
bool kiln_land_factors_sane(const struct kiln_land_factors *factors);

#endif
