/* Rays between patches, shared by the passes over patches (worker/pass/patches.h, worker/pass/links.h). */
#ifndef KILN_WORKER_BACKEND_EMBREE_PATCH_RAY_H
#define KILN_WORKER_BACKEND_EMBREE_PATCH_RAY_H

#include "shaders/shared/area_light.h"
#include "worker/backend/embree/passage.h"

/* Sets ray i of a packet to go between two places. False: the places are the same. */
static inline bool patch_ray(struct RTCRay8 *rays, uint32_t i, struct kiln_vec3 from, struct kiln_vec3 to)
{
    const struct kiln_vec3 d = vec3_sub(to, from);
    const float length = vec3_length(d);
    if (!(length > 0.0f))
        return false;
    rays->org_x[i] = from.x, rays->org_y[i] = from.y, rays->org_z[i] = from.z;
    rays->dir_x[i] = d.x / length, rays->dir_y[i] = d.y / length, rays->dir_z[i] = d.z / length;
    rays->tnear[i] = rays->time[i] = 0.0f;
    rays->tfar[i] = (float)((double)length * KILN_SHADOW_LENGTH);
    rays->mask[i] = ~0u;
    rays->flags[i] = 0;
    return true;
}

#endif
