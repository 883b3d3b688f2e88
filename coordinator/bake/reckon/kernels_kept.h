/* Number of kernels that a bake on a device must wait for. Whether a kernel is kept from an earlier bake shows only
 * when the device has started (worker/base/kernel_store.h); so a bake that has ended leaves a mark beside the kernels,
 * by the kind of bake, and the next bake of that kind finds them all. */
#ifndef KILN_COORDINATOR_BAKE_RECKON_KERNELS_KEPT_H
#define KILN_COORDINATOR_BAKE_RECKON_KERNELS_KEPT_H

#include "coordinator/integrate/settings.h"
#include "coordinator/job/job.h"
#include "worker/scene/scene.h"

/* Expected number of the kernels that a device has to make: 0 if a bake of this kind has left a mark. Not collective.
 */
double kiln_kernels_missing(const struct kiln_job *job, const struct kiln_integrate_settings *settings,
                            const struct kiln_scene *scene);
/* Leaves the mark of a bake that a device has done. Not collective. */
void kiln_kernels_mark(const struct kiln_job *job, const struct kiln_integrate_settings *settings,
                       const struct kiln_scene *scene);

#endif
