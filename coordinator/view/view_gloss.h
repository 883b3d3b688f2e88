/* Views of mirrors, gloss and glass, with lightmaps: rays continue from surfaces with a glossy material
 * (kiln_scene_take_gloss) until they hit a purely diffuse surface, whose lightmap is read, or leave the scene.
 *
 * At a glossy surface a ray gathers three terms: diffuse light, color E / pi times the fraction of E that enters the
 * diffuse part (kiln_diffuse_in, as if E came from all directions); emission; and highlights of lamps, suns and skies,
 * by combining light samples and continued rays (view_lamps.h). Rays from rough gloss are also guided to bright places
 * that their lobes rarely hit (view_guide.h). Light by rough lobes is noisy and is denoised over the whole picture
 * (view_grain.h). Smooth glass splits a ray in two, reflected and refracted, at the first two surfaces. Not
 * collective. */
#ifndef KILN_COORDINATOR_VIEW_VIEW_GLOSS_H
#define KILN_COORDINATOR_VIEW_VIEW_GLOSS_H

#include "coordinator/view/view_light.h"

struct kiln_view_gloss;

/* Borrows the view and its lightmaps. KILN_SYSTEM. */
int kiln_view_gloss_create(struct kiln_view_gloss **gloss, const struct kiln_view_params *params,
                           struct kiln_view_maps *maps, struct kiln_error *error);
void kiln_view_gloss_destroy(struct kiln_view_gloss **gloss);

/* Draws `count` pixels of the picture, numbered y * width + x: radiance without the light by rough lobes, three floats
 * each, the mean over 64 rays, or over 4 for previews. A pixel that is not `done` on entry first gets one ray. If this
 * ray meets no rough lobe, no others are traced, and the radiance is that of the one ray. On return `done` tells which
 * pixels have all rays. No pixel may be drawn twice. The same bits for any number of threads, and for any grouping of
 * pixels. KILN_SYSTEM, KILN_NO_INPUT, KILN_BAD_INPUT, or the status of the backend. */
int kiln_view_gloss_draw(struct kiln_view_gloss *gloss, const size_t *pixels, size_t count, float *rgb, bool *done,
                         struct kiln_error *error);

/* Draws the remaining rays of pixels that are not done. On entry `rgb` is the result of kiln_view_gloss_draw for them,
 * on return the mean over all rays. */
int kiln_view_gloss_draw_rest(struct kiln_view_gloss *gloss, const size_t *pixels, size_t count, float *rgb,
                              struct kiln_error *error);

/* Denoises the light by rough lobes of the drawn pixels and adds it to the planes of the picture. To be called once.
 * KILN_SYSTEM. */
int kiln_view_gloss_smooth(struct kiln_view_gloss *gloss, float *const planes[3], struct kiln_error *error);

#endif
