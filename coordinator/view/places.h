/* Places to look from: cameras inside a scene that are chosen by the scene alone, the same for every run. Not
 * collective.
 */
#ifndef KILN_COORDINATOR_VIEW_PLACES_H
#define KILN_COORDINATOR_VIEW_PLACES_H

#include "worker/scene/scene.h"

/* Chooses `wanted` cameras: places half-way from surfaces along their normals to what is opposite, from where no back
 * of a surface is seen and little of the outside, each looking level into the direction where it sees farthest, and
 * seeing light there, by a few paths. Writes them to `path` as key frames (camera_path.h), whatever there was.
 * KILN_BAD_INPUT if the scene has too few such places. */
int kiln_places_write(const struct kiln_scene *scene, size_t wanted, const char *path, struct kiln_error *error);

#endif
