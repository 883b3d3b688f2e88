#include "coordinator/bake/reckon/preview_size.h"

#include <math.h>

/* Costs that the preview's size is chosen by. A ray of light takes about 0.2 us; other work on a point takes as long as
 * OTHER_RAYS rays. A pixel takes 0.3 us, and 2.5 times that if materials have gloss. */
enum { OTHER_RAYS = 60, ENDLESS_BOUNCES = 8, RAYS_A_PIXEL = 60, RAYS_A_PIXEL_GLOSS = 150, PIXELS_LEAST = 480 * 360 };
static const double PIXELS_FULL = 960.0 * 800.0; /* 960 wide; the height depends on the camera: usually 720 to 960 */

uint64_t kiln_preview_pixels(const struct kiln_job *j, const struct kiln_scene *scene, double points)
{
    const uint64_t bounces = j->light.bounces < 0 ? ENDLESS_BOUNCES : (uint64_t)j->light.bounces,
                   rays = OTHER_RAYS + j->light.samples_direct + j->light.samples_indirect +
                          bounces * j->light.samples_bounce,
                   pixels = (uint64_t)points * rays / (scene->taken != NULL ? RAYS_A_PIXEL_GLOSS : RAYS_A_PIXEL);
    return pixels > PIXELS_LEAST ? pixels : PIXELS_LEAST;
}

double kiln_preview_share(const struct kiln_job *job, const struct kiln_scene *scene, double points)
{
    return fmin((double)kiln_preview_pixels(job, scene, points) / PIXELS_FULL, 1.0);
}
