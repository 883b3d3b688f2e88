/* Light that paths deposit in the spheres about probes (worker/pass/spheres.h). */
#ifndef KILN_WORKER_BACKEND_EMBREE_SPHERES_H
#define KILN_WORKER_BACKEND_EMBREE_SPHERES_H

#include "worker/backend/embree/sphere_sums.h"
#include "worker/backend/embree/walk.h"
#include "worker/pass/spheres.h"

/* A segment of a light path, from surface to surface. */
struct spheres_part {
    struct kiln_vec3 origin, direction; /* m from the scene's centre; unit */
    double length;                      /* m; INFINITY: it meets nothing */
    double flux[3];                     /* flux at its begin, W */
    double relative;                    /* luminance of the flux relative to that of a mean path of its aim */
    size_t aim;
    double pick;               /* random number in (0, 1): the place on each chord */
    uint32_t chance;           /* seed of its random decisions at partly transparent surfaces */
    const struct meeting *end; /* surface at its end, to find a body that contains the segment; NULL: none */
};

/* Records the chords through the spheres that the segment crosses. Counts rays in the walk. Thread-safe. */
void spheres_cross(struct walk *walk, const struct kiln_probe_spheres *spheres, const struct spheres_part *part,
                   struct sphere_chords *chords);

#endif
