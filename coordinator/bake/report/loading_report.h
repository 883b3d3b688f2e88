/* Report on the work done beside the loading of a scene, for run.json and the timeline. */
#ifndef KILN_COORDINATOR_BAKE_REPORT_LOADING_REPORT_H
#define KILN_COORDINATOR_BAKE_REPORT_LOADING_REPORT_H

#include <jansson.h>

#include "coordinator/bake/prepare/prepare.h"

/* Collective. On rank 0 {first_pass_after, device: {seconds, waited_seconds}, bvh: {seconds, waited_seconds}, kernels:
 * {count, seconds, waited_seconds}}, elsewhere NULL. `bvh` is all of the backend that was built beside the search for
 * surface points, and in which the device was waited for. Seconds are the largest of any rank, kernels those that
 * threads made and passes asked for, of all ranks; 0 where there is no device. waited_seconds of these overlapped with
 * nothing. Adds them to the phases' timeline. */
json_t *kiln_loading_report(const struct kiln_prepared *prepared, const struct kiln_phases *phases);

#endif
