/* Views of mirrors, gloss and glass over lightmaps: rays go on from surfaces whose material is taken with its gloss
 * (kiln_scene_take_gloss) until a surface that is only diffuse answers from its lightmap, or the surroundings do.
 *
 * Of a glossy surface itself a ray brings color E / pi times what its diffuse part takes up of light from there
 * (kiln_diffuse_in, as if E came from all over), what it emits, and highlights of lamps, suns and skies, of which light
 * samples and the rays that go on bring their parts (view_lamps.h). Rays that leave rough gloss go to bright places
 * that their lobes rarely meet, too (view_guide.h). What rough lobes bring has noise, which is taken out over the whole
 * picture (view_grain.h). From smooth glass a ray goes both ways, at the first two surfaces. Not collective. */
#ifndef KILN_COORDINATOR_VIEW_VIEW_GLOSS_H
#define KILN_COORDINATOR_VIEW_VIEW_GLOSS_H

#include "coordinator/view/view_light.h"

struct kiln_view_gloss;

/* Borrows the view and its lightmaps. KILN_SYSTEM. */
int kiln_view_gloss_create(struct kiln_view_gloss **gloss, const struct kiln_view_params *params,
                           struct kiln_view_maps *maps, struct kiln_error *error);
void kiln_view_gloss_destroy(struct kiln_view_gloss **gloss);

/* The radiance of `count` pixels of the picture, row by row y * width + x, but for what rough lobes bring, into three
 * floats each: the mean over 64 rays, or over 4 for previews. Of a pixel of these that is not `done` on entry one ray
 * comes first; where it meets no rough lobes the others are not traced, and the radiance is what that one has brought.
 * On return `done` says which pixels have all rays. No pixel may be drawn twice. The same bits for any number of
 * threads, and for any pixels together. KILN_SYSTEM, KILN_NO_INPUT, KILN_BAD_INPUT, or the status of the backend. */
int kiln_view_gloss_draw(struct kiln_view_gloss *gloss, const size_t *pixels, size_t count, float *rgb, bool *done,
                         struct kiln_error *error);

/* Likewise the other rays of pixels that are not done: on entry `rgb` is what that function gave for them, on return
 * the mean over all rays. */
int kiln_view_gloss_draw_rest(struct kiln_view_gloss *gloss, const size_t *pixels, size_t count, float *rgb,
                              struct kiln_error *error);

/* Adds to the planes of the picture what rough lobes bring to the pixels that were drawn. Once. KILN_SYSTEM. */
int kiln_view_gloss_smooth(struct kiln_view_gloss *gloss, float *const planes[3], struct kiln_error *error);

#endif
