/* Report on the work done beside the loading of a scene, for run.json and the timeline. */
#ifndef KILN_COORDINATOR_BAKE_REPORT_LOADING_REPORT_H
#define KILN_COORDINATOR_BAKE_REPORT_LOADING_REPORT_H

#include <jansson.h>

#include "coordinator/bake/prepare/prepare.h"

/* Collective. Makes, on rank 0, {first_pass_after, device: {seconds, waited_seconds}, bvh: {seconds, waited_seconds},
 * kernels: {count, seconds, waited_seconds, slowest: [{name, constants, seconds}]}}; NULL on other ranks. `bvh` covers
 * all of the backend that was built during the search for surface points, including the wait for the device. Seconds
 * are the largest of any rank. `kernels` counts those that threads compiled and passes needed, of all ranks; 0 without
 * a device. waited_seconds is the part that overlapped with nothing. `slowest` has the kernels of rank 0 that took
 * longest to make or to find kept, slowest first, and the values of their specialisation constants
 * (shaders/kernel.glsl) by number. Adds these times to the phases' timeline. */
json_t *kiln_loading_report(const struct kiln_prepared *prepared, const struct kiln_phases *phases);

#endif
