/* Assignment of lightmaps to the ranks that write them.
 *
 * Objects are assigned to ranks by size: largest first, each to the rank with the fewest texels so far. An object that
 * alone is a large part of a rank's work is divided into bands (bands.h): its points go to the ranks that have their
 * rows. Objects are written in rounds, so that a rank holds images of about `texel_budget` texels at a time, and at
 * least one object, however large the scene is. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_BANDS_ASSIGNMENT_H
#define KILN_COORDINATOR_OUTPUT_MAP_BANDS_ASSIGNMENT_H

#include <stddef.h>
#include <stdint.h>

#include "worker/base/status.h"
#include "worker/scene/scene.h"
#include "worker/scene/surface.h"

/* Owner of a lightmap in bands: all ranks share it. */
#define KILN_IN_BANDS (KILN_NONE - 1)

/* The fewest texels of a lightmap in bands by default: fewer take one thread less than half a second. */
#define KILN_BANDS_LEAST (1ull << 19)

/* The assignment of lightmaps to ranks and rounds. It depends on sizes only and is the same on all ranks. Lightmaps
 * that are not published have the owner KILN_NONE. The first `own_rounds` rounds are of lightmaps that one rank owns,
 * the others of those in bands. */
struct kiln_assignment {
    size_t count;
    uint32_t rounds, own_rounds;
    uint32_t *owner, *round; /* of each lightmap */
};
/* Lightmaps are divided into bands if they have at least `least_in_bands` texels and more than a quarter of a rank's
 * mean number of texels. */
int kiln_assignment_create(struct kiln_assignment **assignment, const struct kiln_lightmap *lightmaps, size_t count,
                           uint32_t ranks, uint64_t texel_budget, uint64_t least_in_bands, struct kiln_error *error);
void kiln_assignment_destroy(struct kiln_assignment **assignment);

#endif
