/* Visibility of radiance probes: determines which of the eight probes around a surface point are visible from it. The
 * result is one word of bits per point, near_probes of worker/scene/surface.h. */
#ifndef KILN_COORDINATOR_INTEGRATE_PROBES_RADIANCE_SIGHT_H
#define KILN_COORDINATOR_INTEGRATE_PROBES_RADIANCE_SIGHT_H

#include "worker/backend/backend.h"

struct kiln_sight_params {
    struct kiln_backend *backend;
    const struct kiln_surface *surface;        /* this rank's points */
    const struct kiln_radiance_probes *probes; /* grid and positions */
    bool all;                                  /* for tests: every point counts all probes as visible */
    uint32_t threads;
};

/* Fills in the near_probes words of the points of tile runs [first, end). A cell has eight probes about it; bits mark
 * those visible from a place in the middle of the point, with nothing in between and nothing right behind the probe. A
 * point that can gather no light sees none.
 *
 * A point in a narrow gap sees none either: its rays that end in the gap would use a probe outside, which sees more
 * than the point does. The criterion is that its nearest visible probe is farther than the range and farther than the
 * surroundings. Their distance is the harmonic mean over 16 cosine-distributed rays, the validity radius of irradiance
 * (Ward and Heckbert, "Irradiance Gradients", 1992). Adds the rays to *rays. Not collective. KILN_SYSTEM,
 * KILN_NO_DEVICE. */
int kiln_sight_find(const struct kiln_sight_params *params, size_t first, size_t end, uint32_t *near_probes,
                    uint64_t *rays, struct kiln_error *error);

#endif
