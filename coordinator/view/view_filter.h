/* Filters against noise in path-traced views: one by known data of their surfaces (bmfr.h), means over the frames of a
 * path of cameras (history.h), or both.
 *
 * Both work on light without the colour of what is seen first: y = (radiance - emission) / max(albedo, 0.02), and so
 * keep the patterns of textures. What they return is y x albedo + emission again. The variance of y, which the filter
 * goes by, is that of the picture's halves (struct kiln_view_params, `spread`), or of a picture of one path a pixel how
 * far each pixel is from the four around it.
 *
 * Filtered are pixels all of whose rays see a surface, with no lamp in them or beside them: edges of others are kept.
 * Of smooth mirrors and glass the filter's features are those of the surface that they show most of, where there is one
 * (view_surfaces.h), and emission and albedo are that surface's, with what of them comes by this way; of rough ones and
 * of what shows the surroundings they are those of their own surface, which says nothing about what is seen there; the
 * filter sees that itself, by the variance. In a sequence, pixels at edges of the surroundings and of lamps, and
 * those of surfaces whose material is taken with its gloss, are means over frames as long as the camera stands still.
 * Surfaces are those of 4 x 4 rays a pixel, in a sequence of 2 x 2.
 *
 * A mean is over all frames until the newest one has 0.1 of the weight. With both, these means are filtered, each frame
 * in other blocks, and the filtered frames are averaged once more (Koskela et al. 2019), the newest one with 0.5 of the
 * weight: what the first mean has taken in slowly, a second slow one would keep from being seen.
 *
 * Not collective. The same bits for any number of threads. */
#ifndef KILN_COORDINATOR_VIEW_VIEW_FILTER_H
#define KILN_COORDINATOR_VIEW_VIEW_FILTER_H

#include "coordinator/view/view.h"

struct kiln_view_filter;

/* `sequence`: pictures are frames that follow each other. `denoise`: they are filtered by their surfaces. */
int kiln_view_filter_create(struct kiln_view_filter **filter, bool sequence, bool denoise, struct kiln_error *error);
void kiln_view_filter_destroy(struct kiln_view_filter **filter);

/* Says in params what the next picture has to be traced with: `spread`, and in a sequence `frame`. */
void kiln_view_filter_prepare(const struct kiln_view_filter *filter, struct kiln_view_params *params);

/* Filters a picture of these params, which has channels R G B, and spread.R G B if it was asked for and has more than
 * one path a pixel. The image has R G B afterwards. KILN_SYSTEM, or the status of the backend, which sees surfaces. */
int kiln_view_filter_run(struct kiln_view_filter *filter, const struct kiln_view_params *params,
                         struct kiln_image **image, struct kiln_error *error);

/* Seconds that all pictures so far took here, and how many of them were for seeing surfaces. */
void kiln_view_filter_seconds(const struct kiln_view_filter *filter, double *all, double *surfaces);

#endif
