/* What a view sees besides light: which surface, of which colour, where and how far. For denoisers, compositing and
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

#endif
