/* Data of a view besides light: which surface, of which colour, where and how far. For denoisers, compositing and
 * checks. Nothing here is collective. */
#ifndef KILN_COORDINATOR_VIEW_VIEW_SURFACES_H
#define KILN_COORDINATOR_VIEW_VIEW_SURFACES_H

#include "coordinator/view/view.h"

/* Adds channels to a picture of these params, of the surfaces that rays see first (the backs of single-sided ones are
 * not seen), by 4 x 4 rays for each pixel:
 *
 *   albedo.R G B    base colour, 0 to 1; mean over the rays, 0 where there is no surface
 *   emission.R G B  emitted radiance; mean
 *   normal.X Y Z    shading normal, world, on the side that is seen; mean of unit vectors
 *   position.X Y Z  world, m, at the place nearest to the pixel's middle; 0 where there is no surface
 *   Z               m along the camera's axis, there; KILN_VIEW_FAR where there is no surface
 *
 * KILN_SYSTEM, or the status of the backend; the image is then as it was. */
int kiln_view_add_surfaces(const struct kiln_view_params *params, struct kiln_image **image, struct kiln_error *error);

#define KILN_VIEW_FAR 1e10f

/* The same, for denoisers, as planes: the first of three numbers, or the only one.
 *
 * With planes of what is reached, rays go on from mirrors and smooth glass that have no diffuse part, each in the
 * direction that shows most (kiln_particle_shows), by way of 16 such surfaces at most. What such a ray reaches then
 * stands for what it sees, in albedo and emission too: these are multiplied by the shares of light that the surfaces on
 * the way send on, that bodies of glass let through and that tinted surfaces behind the first one do. A ray that
 * reaches nothing that is seen stands for the first surface, as do all others. */
enum {
    KILN_SEEN_ALBEDO,
    KILN_SEEN_EMISSION = 3,
    KILN_SEEN_NORMAL = 6,
    KILN_SEEN_POSITION = 9,
    KILN_SEEN_DEPTH = 12,
    KILN_SEEN_COVERAGE, /* 0 to 1: how many of the rays see a surface */
    KILN_SEEN_GLOSS,    /* 0 to 1: how many see one whose material is taken with its gloss (view_gloss.h) */
    KILN_SEEN_REACHED_NORMAL,
    KILN_SEEN_REACHED_POSITION = 18, /* both where the ray's way ends: not mirrored */
    KILN_SEEN_PLANES = 21
};

/* Fills planes of zeros, width x height values each, by `side` x `side` rays for each pixel. Planes from that of
 * coverage on may be NULL. */
int kiln_view_see_surfaces(const struct kiln_view_params *params, uint32_t side, float *const planes[KILN_SEEN_PLANES],
                           struct kiln_error *error);

/* Where positions are taken, in pixels from a pixel's upper left corner, with `side` x `side` rays for each. */
static inline double kiln_view_seen_place(uint32_t side) { return ((side - 1) / 2 + 0.5) / side; }

#endif
