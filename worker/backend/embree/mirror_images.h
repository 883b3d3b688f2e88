/* Light of point-like lamps reflected by flat mirrors, for points of a tile run (worker/backend/mirror_images.h).
 * Thread-safe but for `walk` and `rays`, which belong to one thread. */
#ifndef KILN_WORKER_BACKEND_EMBREE_MIRROR_IMAGES_H
#define KILN_WORKER_BACKEND_EMBREE_MIRROR_IMAGES_H

#include "worker/backend/embree/rays.h"
#include "worker/backend/embree/walk.h"
#include "worker/backend/mirror_images.h"

/* Light of a point, W/m2: means over its places. */
struct image_light {
    double irradiance[3], incident[3]; /* irradiance about the shading normal; incident light */
    double error;                      /* standard error of the luminance of `irradiance` */
};

/* Computes the light of point j of a tile run begun by rays_begin. From the place of each sample a ray goes to every
 * mirror in which a lamp may be visible, and another from there to the lamp. Adds its rays to walk->rays. */
void images_light(struct walk *walk, const struct kiln_mirror_images *images, struct tile_run_rays *rays, uint32_t j,
                  struct image_light *light);

#endif
