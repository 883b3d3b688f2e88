/* Bounds of the irradiance volume: the bounds of the objects that receive light, without the sky around them.
 *
 * They are the box of all objects of the scene, with two exceptions. Caster-only objects count only if there are no
 * others. Sources, which are there to be seen or to give light, count only as long as the box's longest side stays
 * below KILN_VOLUME_SOURCE times that of the box without them: a sky dome 500 m around a room would leave the room
 * without a probe. Sources are objects all of whose materials are black, all of whose materials emit, or whose name,
 * mesh or materials are called a sky ("sky", "SkyDome", "sky_sphere"). */
#ifndef KILN_COORDINATOR_BAKE_VOLUME_VOLUME_BOUNDS_H
#define KILN_COORDINATOR_BAKE_VOLUME_VOLUME_BOUNDS_H

#include "worker/scene/scene.h"

#define KILN_VOLUME_SOURCE 4.0

struct kiln_volume_bounds {
    double low[3], high[3]; /* world, m */
    size_t left_out;        /* sources that reach beyond them */
    uint32_t largest;       /* object of the longest left-out source; KILN_NONE: there is none */
    double longest;         /* that side, m */
};

/* Not collective, no side effects; time grows with the vertices of the scene. KILN_SYSTEM. */
int kiln_volume_bounds_find(struct kiln_volume_bounds *bounds, const struct kiln_scene *scene,
                            struct kiln_error *error);

#endif
