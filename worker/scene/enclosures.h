/* Which objects have something in them, such as a room that is one mesh: the middle of another object's bounds, a lamp
 * or a camera lies within theirs; and an object that is alone in its scene. */
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
/* Whether the object has something in it. The first question about an object takes time that grows with the number of
 * objects. One thread at a time. */
bool kiln_encloses(struct kiln_enclosures *enclosures, uint32_t object);

#endif
