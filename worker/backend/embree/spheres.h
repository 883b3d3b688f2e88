/* What light paths leave in the spheres about probes (worker/pass/spheres.h). */
#ifndef KILN_WORKER_BACKEND_EMBREE_SPHERES_H
#define KILN_WORKER_BACKEND_EMBREE_SPHERES_H

#include "worker/backend/embree/walk.h"
#include "worker/pass/spheres.h"
#include "worker/sampling/harmonics.h"

_Static_assert(KILN_SPHERE_WEIGHTS == KILN_HARMONICS + 6, "harmonics and axes");

/* What light from unit direction d counts by: harmonics, and irradiance along +x -x +y -y +z -z. */
static inline void spheres_weights(struct kiln_dvec3 d, double weights[KILN_SPHERE_WEIGHTS])
{
    const double along[3] = {d.x, d.y, d.z};
    kiln_harmonics(d, weights);
    for (int a = 0; a < 3; a++) {
        weights[KILN_HARMONICS + 2 * a] = along[a] > 0.0 ? along[a] : 0.0;
        weights[KILN_HARMONICS + 2 * a + 1] = along[a] < 0.0 ? -along[a] : 0.0;
    }
}

/* A part of a light path, from surface to surface. */
struct spheres_part {
    struct kiln_vec3 origin, direction; /* m from the scene's centre; unit */
    double length;                      /* m; INFINITY: it meets nothing */
    double flux[3];                     /* W, where it begins */
    double relative;                    /* luminance of the flux over that of a mean path of its aim */
    size_t aim;
    double pick;               /* random number in (0, 1): the place on each chord */
    uint32_t chance;           /* what its chances with surfaces that let light through hang on */
    const struct meeting *end; /* the surface met, to know a body that the part lies in; NULL: none */
};

/* Adds what the part brings to the spheres that it crosses. Counts rays in the walk. Thread-safe. */
void spheres_cross(struct walk *walk, const struct kiln_probe_spheres *spheres, const struct spheres_part *part);

#endif
