/* Rays of a camera (worker/pass/path.h), with and without a lens. Pure. */
#ifndef KILN_WORKER_BACKEND_EMBREE_CAMERA_RAY_H
#define KILN_WORKER_BACKEND_EMBREE_CAMERA_RAY_H

#include "worker/pass/path.h"

/* Makes the ray through a place in a pixel, from a place on the lens if the camera has one. Both places are given by
 * two numbers in (0, 1). `direction` is unit. */
static inline void embree_camera_ray(const struct kiln_path_parameters *c, uint64_t pixel, const double place[2],
                                     const double lens[2], struct kiln_vec3 *origin, struct kiln_vec3 *direction)
{
    const float x = (float)(((double)(pixel % c->width) + place[0]) / c->width * 2.0 - 1.0),
                y = (float)(1.0 - ((double)(pixel / c->width) + place[1]) / c->height * 2.0);
    const struct kiln_vec3 aside = vec3_madd(vec3_scale(c->right, x), c->up, y);
    *origin = c->orthographic ? vec3_add(c->position, aside) : c->position;
    *direction = vec3_normalize(c->orthographic ? c->forward : vec3_add(c->forward, aside));
    if (!(c->lens_radius > 0.0f))
        return;
    const struct kiln_vec3 from = kiln_path_lens(c->right, c->up, c->lens_radius, (float)lens[0], (float)lens[1]),
                           focus = vec3_scale(vec3_add(c->forward, aside), c->focus_distance);
    *origin = vec3_add(*origin, from);
    *direction = vec3_normalize(vec3_sub(focus, from));
}

#endif
