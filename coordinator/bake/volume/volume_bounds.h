/* Bounds of the irradiance volume: those of what receives light, without the sky around it.
 *
 * The box of all objects is that of the scene, except for two kinds. Objects that only cast (caster-only) count only if
 * there is nothing else. Sources, which are there to be seen or to give light, count only as far as the box's longest
 * side stays below KILN_VOLUME_SOURCE times that of the rest: a sky dome 500 m around a room would leave the room
 * without a probe. Sources are objects all of whose materials are black, all of whose materials emit, or whose name,
 * mesh or materials are called a sky ("sky", "SkyDome", "sky_sphere"). */
#ifndef KILN_COORDINATOR_BAKE_VOLUME_VOLUME_BOUNDS_H
#define KILN_COORDINATOR_BAKE_VOLUME_VOLUME_BOUNDS_H

#include "worker/scene/scene.h"

#define KILN_VOLUME_SOURCE 4.0

struct kiln_volume_bounds {
    double low[3], high[3]; /* world, m */
    size_t left_out;        /* sources that reach beyond them */
    uint32_t largest;       /* of those, the object with the longest side; KILN_NONE: there is none */
    double longest;         /* that side, m */
};

/* Not collective, no side effects; time grows with the vertices of the scene. KILN_SYSTEM. */
int kiln_volume_bounds_find(struct kiln_volume_bounds *bounds, const struct kiln_scene *scene,
                            struct kiln_error *error);

#endif
