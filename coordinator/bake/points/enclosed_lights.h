/* Enclosed lamps: lamps whose light does not get out, such as a lamp inside the mesh of its bulb. A lamp here is a
 * point or spot light or an emitting object; every ray from it ends on the backs of single-sided surfaces, or on opaque
 * surfaces close by. */
#ifndef KILN_COORDINATOR_BAKE_POINTS_ENCLOSED_LIGHTS_H
#define KILN_COORDINATOR_BAKE_POINTS_ENCLOSED_LIGHTS_H

#include "worker/backend/backend.h"
#include "worker/light/lights.h"

struct kiln_enclosed_light {
    uint32_t light;  /* index among the scene's punctual lights; KILN_NONE: the lamp is an object */
    uint32_t source; /* the object that emits, or KILN_NONE */
    uint32_t object; /* the object that most rays of the lamp end on */
};

/* Finds the enclosed lamps of the backend's scene by tracing rays from each lamp, on this process alone; the rays are
 * the same on any backend. Release `*list` with kiln_free. Not collective. KILN_SYSTEM, and the backend's failures. */
int kiln_enclosed_lights_find(struct kiln_enclosed_light **list, size_t *count, struct kiln_backend *backend,
                              struct kiln_error *error);

/* Writes the sentence about an enclosed lamp, without the name of the lamp, to `text`. */
void kiln_enclosed_light_text(const struct kiln_enclosed_light *light, const struct kiln_scene *scene, char *text,
                              size_t size);
/* The lamp's name. */
const char *kiln_enclosed_light_name(const struct kiln_enclosed_light *light, const struct kiln_scene *scene);

#endif
