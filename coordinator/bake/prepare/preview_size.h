/* How large the picture is that a bake draws of its result: for the bake, and for `kiln plan`. Not collective. */
#ifndef KILN_COORDINATOR_BAKE_PREPARE_PREVIEW_SIZE_H
#define KILN_COORDINATOR_BAKE_PREPARE_PREVIEW_SIZE_H

#include <stdint.h>

#include "coordinator/job/job.h"
#include "worker/scene/scene.h"

/* Pixels of the preview at most: it is to take a thirtieth of the bake, but of a bake of seconds more. By counts, not
 * by clocks: a bake that was interrupted has the same picture. `points`: surface points of all ranks. */
uint64_t kiln_preview_pixels(const struct kiln_job *job, const struct kiln_scene *scene, double points);

/* kiln_preview_pixels over the pixels of a preview that nothing limits, 1 at most. */
double kiln_preview_part(const struct kiln_job *job, const struct kiln_scene *scene, double points);

#endif
