/* Lookups of base colour, opacity and emission of a scene's surfaces. Pure functions, thread-safe. */
#ifndef KILN_WORKER_SCENE_TEXTURE_H
#define KILN_WORKER_SCENE_TEXTURE_H

#include "worker/scene/scene.h"

/* Linear RGBA of texture `index` at (u, v), filtered and wrapped as the texture says. */
void kiln_texture_sample(const struct kiln_scene *scene, uint32_t index, float u, float v, float rgba[4]);

/* The linear value of each 8-bit sRGB code. */
void kiln_texture_codes(float linear[256]);

/* In all functions below, `triangle` is an index into the scene's stored triangles and must belong to `mesh`; b1 and b2
 * are the barycentric weights of its corners 1 and 2. */

/* Diffuse albedo (linear RGB, 0..1) in rgba[0..2]: base colour x vertex colour x texture x (1 - metallic); alpha in
 * [3]. */
void kiln_surface_color(const struct kiln_scene *scene, const struct kiln_mesh *mesh, uint64_t triangle, float b1,
                        float b2, float rgba[4]);
/* kiln_surface_color for many positions of one triangle, with their common values precomputed. Borrows the scene. */
struct kiln_paint {
    const struct kiln_scene *scene;
    float factor[4], kept[4]; /* material: base colour; factors 1 - metallic (alpha: 1) */
    float vertex[3][4];       /* codes, 0..255 */
    struct kiln_vec2 at[3];   /* in the texture */
    uint32_t texture;         /* KILN_NONE: none */
};
void kiln_paint_prepare(struct kiln_paint *paint, const struct kiln_scene *scene, const struct kiln_mesh *mesh,
                        uint64_t triangle);
enum { KILN_PAINT_MOST = 16 };
/* Colours as of kiln_surface_color at `count` positions, at most KILN_PAINT_MOST. */
void kiln_paint_colors(const struct kiln_paint *paint, const float *b1, const float *b2, int count, float (*rgba)[4]);
/* Passage of light through a surface at a position. The fraction `opacity` of the light hits the surface, which
 * reflects it with the albedo of kiln_surface_color. The rest passes, with the factors `through`; so passing light is
 * tinted by through / (1 - opacity).
 *
 *   opacity = a (1 - t),  through = (1 - a) + a t (1 - R) (1 - metallic) base colour
 *
 * Here a is the alpha (0 or 1 for a mask, 1 for an opaque material) and t the transmission, times its texture: glTF's
 * alpha coverage and KHR_materials_transmission of a thin wall, which tints each time light crosses it. Light goes
 * straight on: no refraction, no blur by roughness. R is the reflectance of a pane (kiln_pane_share; 4 % at normal
 * incidence and an index of 1.5) if light transport takes materials with their gloss (kiln_scene_take_gloss), else 0. R
 * depends on `cosine`, 0 to 1, of the angle between ray and face normal. Light reflected by R is lost, as no ray is
 * mirrored by a pane. Light neither reflected nor let through is absorbed. */
struct kiln_passage {
    float opacity, through[3];
};
void kiln_surface_passage(const struct kiln_scene *scene, const struct kiln_mesh *mesh, uint64_t triangle, float b1,
                          float b2, float cosine, struct kiln_passage *passage);
/* The opacity alone: cheaper. */
float kiln_surface_opacity(const struct kiln_scene *scene, const struct kiln_mesh *mesh, uint64_t triangle, float b1,
                           float b2);
/* Base colour as kiln_surface_color, without the factor (1 - metallic): a metal's colour, though it reflects nothing
 * diffusely. */
void kiln_surface_base_color(const struct kiln_scene *scene, const struct kiln_mesh *mesh, uint64_t triangle, float b1,
                             float b2, float rgba[4]);
/* Emitted radiance (W m-2 sr-1). */
void kiln_surface_emission(const struct kiln_scene *scene, const struct kiln_mesh *mesh, uint64_t triangle, float b1,
                           float b2, float rgb[3]);
/* Mean of the emitted radiance over the whole triangle's area, by exact integration of the texture's filter (a constant
 * material returns its factor). Good to 1e-3 relative for textures. Used to weigh lights and to account for their
 * power. */
void kiln_triangle_mean_emission(const struct kiln_scene *scene, const struct kiln_mesh *mesh, uint64_t triangle,
                                 float rgb[3]);

#endif
