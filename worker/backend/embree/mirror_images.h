/* Light of lamps without extent by flat mirrors, for points of a tile run (worker/backend/mirror_images.h). Thread-safe
 * but for `walk` and `rays`, which are one thread's. */
#ifndef KILN_WORKER_BACKEND_EMBREE_MIRROR_IMAGES_H
#define KILN_WORKER_BACKEND_EMBREE_MIRROR_IMAGES_H

#include "worker/backend/embree/rays.h"
#include "worker/backend/embree/walk.h"
#include "worker/backend/mirror_images.h"

/* Light of a point, W/m2: means over its places. */
struct image_light {
    double irradiance[3], incident[3]; /* about the shading normal; what the point takes up */
    double error;                      /* standard error of the luminance of `irradiance` */
};

/* Finds the light of point j of a tile run that rays_begin has begun. From the place of each sample a ray goes to every
 * mirror in which a lamp might be seen, and another from there to the lamp. Rays are added to walk->rays. */
void images_light(struct walk *walk, const struct kiln_mirror_images *images, struct tile_run_rays *rays, uint32_t j,
                  struct image_light *light);

#endif
