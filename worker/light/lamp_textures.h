/* Radiance of emitting triangles: emission times opacity, for a part of a lamp that alpha cuts out does not shine. At a
 * place, and the mean over a part of a triangle, by its textures' means (worker/scene/texture_means.h).
 *
 * Radiance is in W m-2 sr-1. Triangles are the world's, and so are barycentric weights, of corners 1 and 2. */
#ifndef KILN_WORKER_LIGHT_LAMP_TEXTURES_H
#define KILN_WORKER_LIGHT_LAMP_TEXTURES_H

#include <stdbool.h>

#include "worker/scene/geometry.h"

/* Means of the textures that emitting materials have. */
struct kiln_lamp_textures;

/* Borrows scene and geometry. Not collective. Destroy with kiln_lamp_textures_destroy. KILN_SYSTEM. */
int kiln_lamp_textures_create(struct kiln_lamp_textures **textures, const struct kiln_scene *scene,
                              const struct kiln_geometry *geometry, struct kiln_error *error);
void kiln_lamp_textures_destroy(struct kiln_lamp_textures **textures);

/* Whether it may send more in one place than in another. */
bool kiln_lamp_is_uneven(const struct kiln_scene *scene, const struct kiln_geometry *geometry, uint32_t triangle);

void kiln_lamp_radiance(const struct kiln_scene *scene, const struct kiln_geometry *geometry, uint32_t triangle,
                        double b1, double b2, float rgb[3]);

/* Mean over a convex polygon of the triangle, `corners` of (b1, b2), at most KILN_TEXTURE_POLYGON; and that of the
 * square of its luminance, as far as cells tell of which `most` lie along the polygon. The mean is 0 only where all of
 * it is; but for what two textures, of emission and of opacity, have together, and for a triangle without area in its
 * texture, which are looked up. */
void kiln_lamp_mean(const struct kiln_lamp_textures *textures, uint32_t triangle, const double (*polygon)[2],
                    uint32_t corners, uint32_t most, double rgb[3], double *square);

#endif
