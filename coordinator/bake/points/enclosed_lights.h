/* Lamps whose light stays where they are: a point or spot light, or an emitting object, of which every ray ends on the
 * backs of single-sided surfaces, or on opaque ones close by, such as a lamp inside the mesh of its bulb. */
#ifndef KILN_COORDINATOR_BAKE_POINTS_ENCLOSED_LIGHTS_H
#define KILN_COORDINATOR_BAKE_POINTS_ENCLOSED_LIGHTS_H

#include "worker/backend/backend.h"
#include "worker/light/lights.h"

struct kiln_enclosed_light {
    uint32_t light;  /* of the scene's punctual lights; KILN_NONE: it is an object */
    uint32_t source; /* the object that emits, or KILN_NONE */
    uint32_t object; /* the one that most of its rays end on */
};

/* Traces rays from each lamp of the backend's scene, on this process alone: the same ones on any backend. `*list` is
 * released with kiln_free. Not collective. KILN_SYSTEM, and the backend's failures. */
int kiln_enclosed_lights_find(struct kiln_enclosed_light **list, size_t *count, struct kiln_backend *backend,
                              struct kiln_error *error);

/* The sentence about one, without the name of the lamp, in `text`. */
void kiln_enclosed_light_text(const struct kiln_enclosed_light *light, const struct kiln_scene *scene, char *text,
                              size_t size);
/* The lamp's name. */
const char *kiln_enclosed_light_name(const struct kiln_enclosed_light *light, const struct kiln_scene *scene);

#endif
