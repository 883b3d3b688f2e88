/* Radiance of emitting triangles: emission times opacity, since texels that alpha cuts out do not shine. It is given at
 * a place, and as the mean over a part of a triangle (worker/scene/texture_means.h).
 *
 * Radiance is in W m-2 sr-1. Triangles are world triangles; b1 and b2 are the barycentric weights of their corners 1
 * and 2. */
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

/* Whether the radiance of an emitting triangle may vary over it. */
bool kiln_lamp_is_uneven(const struct kiln_scene *scene, const struct kiln_geometry *geometry, uint32_t triangle);

void kiln_lamp_radiance(const struct kiln_scene *scene, const struct kiln_geometry *geometry, uint32_t triangle,
                        double b1, double b2, float rgb[3]);

/* Mean radiance over a convex polygon of the triangle with `corners` vertices (b1, b2), at most KILN_TEXTURE_POLYGON;
 * and the mean of its squared luminance, as averaged over cells of which at most `most` lie along the polygon. The mean
 * is 0 only if the radiance is 0 everywhere. Exceptions are textures of both emission and opacity, and triangles
 * without area in texture space: there the mean is sampled. */
void kiln_lamp_mean(const struct kiln_lamp_textures *textures, uint32_t triangle, const double (*polygon)[2],
                    uint32_t corners, uint32_t most, double rgb[3], double *square);

#endif
