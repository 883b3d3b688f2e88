/* Light that paths leave in the spheres about probes (worker/pass/spheres.h). */
#ifndef KILN_WORKER_BACKEND_EMBREE_SPHERES_H
#define KILN_WORKER_BACKEND_EMBREE_SPHERES_H

#include "worker/backend/embree/sphere_sums.h"
#include "worker/backend/embree/walk.h"
#include "worker/pass/spheres.h"

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

/* Notes the chords of the spheres that the part crosses. Counts rays in the walk. Thread-safe. */
void spheres_cross(struct walk *walk, const struct kiln_probe_spheres *spheres, const struct spheres_part *part,
                   struct sphere_chords *chords);

#endif
