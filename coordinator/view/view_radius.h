/* Pixel width of a view, from which the radius of vertex merging derives (worker/pass/bidirectional.h). Private to
 * coordinator; not collective. */
#ifndef KILN_COORDINATOR_VIEW_VIEW_RADIUS_H
#define KILN_COORDINATOR_VIEW_VIEW_RADIUS_H

#include "coordinator/view/view.h"

/* Computes the width of a pixel at the median depth of the picture, m. A merging disc of this width blurs by one pixel.
 * A picture has as many light paths as pixels, so such a disc holds a few of their vertices at any picture size. A
 * picture of fewer than 32 x 32 pixels is treated as one of 32 x 32. Geometry outside the picture has no influence; the
 * scene's extent matters only for the depth of an empty picture and for the minimum depth, 1e-4 of it.
 *
 * Depths come from at most 64 x 64 pinhole rays, which are not counted in statistics. They end at the first surface,
 * even a mirror or glass. The median is rounded to a power of 2^(1/8), so that backends whose hits differ by rounding
 * agree. KILN_SYSTEM, or the status of the backend. */
int kiln_view_pixel_width(struct kiln_backend *backend, const struct kiln_geometry *geometry,
                          const struct kiln_view_params *params, double *width, struct kiln_error *error);

#endif
