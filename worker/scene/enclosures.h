/* Test for objects that enclose something, such as a room that is one mesh. An object encloses something if the middle
 * of another object's bounds, a lamp or a camera lies within its own bounds, or if it is the only object of the scene.
 */
#ifndef KILN_WORKER_SCENE_ENCLOSURES_H
#define KILN_WORKER_SCENE_ENCLOSURES_H

#include "worker/scene/geometry.h"
#include "worker/scene/scene.h"

struct kiln_enclosures;

/* Finds the bounds of all objects; scene and geometry are borrowed. Not collective. KILN_SYSTEM. Destroy with
 * kiln_enclosures_destroy. */
int kiln_enclosures_create(struct kiln_enclosures **enclosures, const struct kiln_scene *scene,
                           const struct kiln_geometry *geometry, struct kiln_error *error);
void kiln_enclosures_destroy(struct kiln_enclosures **enclosures);
/* Whether the object encloses something. The first query of an object takes time proportional to the number of objects.
 * Not thread-safe. */
bool kiln_encloses(struct kiln_enclosures *enclosures, uint32_t object);

#endif
