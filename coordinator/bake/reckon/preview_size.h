/* Size of the preview picture that a bake draws of its result: for the bake, and for `kiln plan`. Not collective. */
#ifndef KILN_COORDINATOR_BAKE_RECKON_PREVIEW_SIZE_H
#define KILN_COORDINATOR_BAKE_RECKON_PREVIEW_SIZE_H

#include <stdint.h>

#include "coordinator/job/job.h"
#include "worker/scene/scene.h"

/* Most pixels of the preview. The preview should take a thirtieth of the bake's time, or more in a bake of seconds. The
 * estimate uses counts of rays, not clocks, so that an interrupted bake has the same picture. `points`: surface points
 * of all ranks. */
uint64_t kiln_preview_pixels(const struct kiln_job *job, const struct kiln_scene *scene, double points);

/* kiln_preview_pixels divided by the pixels of an unlimited preview, at most 1. */
double kiln_preview_share(const struct kiln_job *job, const struct kiln_scene *scene, double points);

#endif
