/* Denoising of path-traced views: by regression on features of their surfaces (bmfr.h), by accumulation over the frames
 * of a camera path (history.h), or both.
 *
 * Both work on demodulated light, y = (radiance - emission) / max(albedo, 0.02) with albedo and emission of the first
 * hit, and so keep the patterns of textures. The result is y x albedo + emission. The regression needs the variance of
 * y. It is estimated from the picture's halves (struct kiln_view_params, `spread`), or with one path per pixel from the
 * difference between a pixel and its four neighbours.
 *
 * A pixel is filtered if all its rays see a surface, and neither it nor a neighbour shows a lamp; so the edges of
 * others are kept. For smooth mirrors and glass, features come from the surface that they mostly show, if there is one
 * (view_surfaces.h); emission and albedo, too, multiplied by the fraction transmitted on the way. Rough surfaces, and
 * mirrors that show the surroundings, have the features of their own surface. These do not explain the light there,
 * which the filter detects by the variance. In a sequence, pixels at edges of the surroundings and of lamps, and pixels
 * of glossy materials, are accumulated only while the camera is at rest. Features are averaged over 4 x 4 rays per
 * pixel, in a sequence over 2 x 2.
 *
 * Accumulation averages all frames until the newest one has a weight of 0.1. With both methods, the accumulated frames
 * are filtered, each with other block offsets, and accumulated once more (Koskela et al. 2019). There the newest frame
 * has a weight of 0.5, so that this second mean does not delay changes further.
 *
 * Not collective. The same bits for any number of threads. */
#ifndef KILN_COORDINATOR_VIEW_VIEW_FILTER_H
#define KILN_COORDINATOR_VIEW_VIEW_FILTER_H

#include "coordinator/view/view.h"

struct kiln_view_filter;

/* Creates a filter. `sequence`: accumulate pictures as frames of a sequence. `denoise`: regression on features. */
int kiln_view_filter_create(struct kiln_view_filter **filter, bool sequence, bool denoise, struct kiln_error *error);
void kiln_view_filter_destroy(struct kiln_view_filter **filter);

/* Sets the fields of params that the filter needs for the next picture: `spread`, and in a sequence `frame`. */
void kiln_view_filter_prepare(const struct kiln_view_filter *filter, struct kiln_view_params *params);

/* Filters a picture of these params. It has channels R G B, and spread.R G B if `spread` was set and it has more than
 * one path per pixel; afterwards only R G B. KILN_SYSTEM, or the status of the backend, which traces features. */
int kiln_view_filter_run(struct kiln_view_filter *filter, const struct kiln_view_params *params,
                         struct kiln_image **image, struct kiln_error *error);

/* Seconds of filtering for all pictures so far, and the part of them spent on tracing surface features. */
void kiln_view_filter_seconds(const struct kiln_view_filter *filter, double *all, double *surfaces);

#endif
