/* Cameras of generated scenes. */
#ifndef KILN_COORDINATOR_GENERATE_CAMERA_H
#define KILN_COORDINATOR_GENERATE_CAMERA_H

#include "coordinator/generate/glb.h"

/* Adds an upright camera at `eye` that looks at `target`. */
int kiln_generate_camera(struct kiln_glb *glb, struct kiln_dvec3 eye, struct kiln_dvec3 target, double angle,
                         double aspect, struct kiln_error *error);
/* Computes the unit quaternion of an upright rotation that takes -z to `direction`. */
void kiln_generate_look(struct kiln_dvec3 direction, double rotation[4]);

#endif
