/* Visibility of radiance probes: finds which of the probes around a surface point the point sees. The result is a word
 * of bits a point, near_probes of worker/scene/surface.h. */
#ifndef KILN_COORDINATOR_INTEGRATE_PROBES_RADIANCE_SIGHT_H
#define KILN_COORDINATOR_INTEGRATE_PROBES_RADIANCE_SIGHT_H

#include "worker/backend/backend.h"

struct kiln_sight_params {
    struct kiln_backend *backend;
    const struct kiln_surface *surface;        /* this rank's points */
    const struct kiln_radiance_probes *probes; /* grid and positions */
    bool all;                                  /* for tests: every point takes all probes for seen */
    uint32_t threads;
};

/* Fills in the words near_probes of the points of tile runs [first, end): of the eight probes about the cell in which a
 * place in the middle of the point lies, those to which nothing bars the way from there, nor stands right behind them.
 * A point where no light can be gathered sees none.
 *
 * A point in a narrow gap has none either: rays that end in the gap would ask a probe outside of it, which sees past
 * what the point sees. So it is where the nearest probe that it sees is farther than the range, and farther than what
 * is around the point: the harmonic mean of the distances along 16 cosine-distributed rays, which is how far the
 * irradiance there holds (Ward and Heckbert, "Irradiance Gradients", 1992). Adds the rays to *rays. Not collective.
 * KILN_SYSTEM, KILN_NO_DEVICE. */
int kiln_sight_find(const struct kiln_sight_params *params, size_t first, size_t end, uint32_t *near_probes,
                    uint64_t *rays, struct kiln_error *error);

#endif
