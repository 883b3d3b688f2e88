/* Parameters for the steps of the directions pass (worker/pass/directions.h) of a bake by radiosity: a set of
 * directions, or the patches that are bright in that step. Nothing here is collective: all ranks make the same. */
#ifndef KILN_COORDINATOR_INTEGRATE_PATCHES_DIRECTIONS_H
#define KILN_COORDINATOR_INTEGRATE_PATCHES_DIRECTIONS_H

#include "coordinator/job/choices.h"
#include "worker/pass/directions.h"
#include "worker/scene/surface.h"

struct kiln_directions;

struct kiln_directions_source {
    const struct kiln_surface *surface;
    const struct kiln_patch_settings *settings;
    const struct kiln_patch *points; /* of all surface points; NULL: no rays go to bright patches, no patch emits */
    const float (*emission)[3];      /* of all points, W/m2; NULL unless patches emit */
};

/* `samples`: rays per point in a step. The source and all in it are borrowed while the directions exist.
 * KILN_SYSTEM. */
int kiln_directions_create(struct kiln_directions **directions, const struct kiln_directions_source *source,
                           uint32_t samples, struct kiln_error *error);
/* NULL is accepted. */
void kiln_directions_destroy(struct kiln_directions **directions);

/* Memory of directions, bytes, for `points` surface points in all. */
uint64_t kiln_directions_bytes(const struct kiln_patch_settings *settings, uint64_t points);

/* Returns the parameters of a step that gathers emission, or the packed radiosity of all points; valid until the next
 * call. */
const struct kiln_directions_parameters *kiln_directions_update(struct kiln_directions *directions,
                                                                const uint64_t *radiosity, bool of_emission);

#endif
