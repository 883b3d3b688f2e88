/* Automatic viewpoints: cameras inside a scene, chosen by the scene alone, so the same for every run. Not collective.
 */
#ifndef KILN_COORDINATOR_VIEW_PLACES_H
#define KILN_COORDINATOR_VIEW_PLACES_H

#include "worker/scene/scene.h"

/* Chooses `wanted` cameras. A camera stands half-way between a surface and the one opposite along its normal. It must
 * see no back of a surface, little of the outside, and, tested by a few paths, light. It looks horizontally in the
 * direction of the farthest view. Writes the cameras to `path` as key frames (camera_path.h), replacing the file.
 * KILN_BAD_INPUT if the scene has too few such places. */
int kiln_places_write(const struct kiln_scene *scene, size_t wanted, const char *path, struct kiln_error *error);

#endif
