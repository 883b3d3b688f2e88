/* Auxiliary channels of a view (AOVs): albedo, emission, normal, position and depth of the visible surfaces, for
 * denoisers, compositing and checks. Nothing here is collective. */
#ifndef KILN_COORDINATOR_VIEW_VIEW_SURFACES_H
#define KILN_COORDINATOR_VIEW_VIEW_SURFACES_H

#include "coordinator/view/view.h"

/* Adds channels of the first visible surfaces to a picture of these params, by 4 x 4 rays per pixel (rays pass through
 * the backs of single-sided surfaces):
 *
 *   albedo.R G B    base colour, 0 to 1; mean over the rays, 0 where there is no surface
 *   emission.R G B  emitted radiance; mean
 *   normal.X Y Z    shading normal, world, on the side that is seen; mean of unit vectors
 *   position.X Y Z  world, m, of the ray nearest to the pixel's centre; 0 where there is no surface
 *   Z               depth of that ray along the camera's axis, m; KILN_VIEW_FAR where there is no surface
 *
 * KILN_SYSTEM, or the status of the backend; the image is then unchanged. */
int kiln_view_add_surfaces(const struct kiln_view_params *params, struct kiln_image **image, struct kiln_error *error);

#define KILN_VIEW_FAR 1e10f

/* Planes of these data for denoisers: index of the first of three planes, or of the only one.
 *
 * With the REACHED planes, rays continue from mirrors and smooth glass without a diffuse part, in the direction of the
 * larger contribution (kiln_particle_shows), over at most 16 such surfaces. The ray then takes the data of the surface
 * it reaches. Albedo and emission are multiplied by the throughput on the way: reflectance or transmittance of the
 * surfaces, absorption in glass, and the tint of surfaces behind the first. A ray that reaches no visible surface, and
 * any other ray, keeps the data of its first surface. */
enum {
    KILN_SEEN_ALBEDO,
    KILN_SEEN_EMISSION = 3,
    KILN_SEEN_NORMAL = 6,
    KILN_SEEN_POSITION = 9,
    KILN_SEEN_DEPTH = 12,
    KILN_SEEN_COVERAGE, /* fraction of the rays that see a surface, 0 to 1 */
    KILN_SEEN_GLOSS,    /* fraction that see a material taken with its gloss (view_gloss.h), 0 to 1 */
    KILN_SEEN_REACHED_NORMAL,
    KILN_SEEN_REACHED_POSITION = 18, /* real normal and position of the reached surface, not its mirror image */
    KILN_SEEN_PLANES = 21
};

/* Fills the planes, width x height values each and zero on entry, by `side` x `side` rays per pixel. Planes from
 * KILN_SEEN_COVERAGE on may be NULL. */
int kiln_view_see_surfaces(const struct kiln_view_params *params, uint32_t side, float *const planes[KILN_SEEN_PLANES],
                           struct kiln_error *error);

/* Sample point of positions in a pixel with `side` x `side` rays: offset from its upper left corner, pixels. */
static inline double kiln_view_seen_place(uint32_t side) { return ((side - 1) / 2 + 0.5) / side; }

#endif
