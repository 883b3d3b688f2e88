/* Pixel width for the radius of merging in a view (worker/pass/bidirectional.h). Private to coordinator; not
 * collective. */
#ifndef KILN_COORDINATOR_VIEW_VIEW_RADIUS_H
#define KILN_COORDINATOR_VIEW_VIEW_RADIUS_H

#include "coordinator/view/view.h"

/* Writes the width of a pixel at the median depth of what the picture shows, m. A disc as wide blurs by a pixel, and
 * as a picture has as many paths of light as pixels, there are a few of their vertices in it whatever the picture's
 * size. A picture of fewer than 32 x 32 pixels counts as having so many. What the camera does not see does not matter:
 * of the scene's extent depend only the depth of a picture that shows nothing and the least depth, 1e-4 of it.
 *
 * Depths are those of at most 64 x 64 rays, which go straight through a pinhole and are not counted. Their median is
 * rounded to a power of 2^(1/8): backends, whose hits differ by rounding, find the same number. The first surface
 * counts, be it a mirror or glass. KILN_SYSTEM, or the status of the backend. */
int kiln_view_pixel_width(struct kiln_backend *backend, const struct kiln_geometry *geometry,
                          const struct kiln_view_params *params, double *width, struct kiln_error *error);

#endif
