/* Looking up base colour, alpha and emission of a scene's surfaces. Pure functions, thread-safe. */
#ifndef KILN_WORKER_SCENE_TEXTURE_H
#define KILN_WORKER_SCENE_TEXTURE_H

#include "worker/scene/scene.h"

/* Linear RGBA of texture `index` at (u, v), filtered and wrapped as the texture says. */
void kiln_texture_sample(const struct kiln_scene *scene, uint32_t index, float u, float v, float rgba[4]);

/* The linear value of each 8-bit sRGB code. */
void kiln_texture_codes(float linear[256]);

/* `triangle` is an index into the scene's stored triangles and must belong to `mesh`; b1, b2 are the barycentric weights
 * of corners 1 and 2. */

/* Diffuse albedo (linear RGB, 0..1) in rgba[0..2]: base colour x vertex colour x texture x (1 - metallic); alpha in [3]. */
void kiln_surface_color(const struct kiln_scene *scene, const struct kiln_mesh *mesh, uint64_t triangle, float b1, float b2,
                        float rgba[4]);
/* The same without the factor (1 - metallic): what a metal is coloured like, which reflects nothing diffusely. */
void kiln_surface_base_color(const struct kiln_scene *scene, const struct kiln_mesh *mesh, uint64_t triangle, float b1, float b2,
                             float rgba[4]);
/* Emitted radiance (W m-2 sr-1). */
void kiln_surface_emission(const struct kiln_scene *scene, const struct kiln_mesh *mesh, uint64_t triangle, float b1, float b2,
                           float rgb[3]);
/* Exact mean over the whole triangle's area of the emitted radiance, by integrating the texture's filter over it (a constant
 * material returns its factor). Good to 1e-3 relative for textures; used to weigh and to account for lights. */
void kiln_triangle_mean_emission(const struct kiln_scene *scene, const struct kiln_mesh *mesh, uint64_t triangle, float rgb[3]);

#endif
