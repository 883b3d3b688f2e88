/* Pictures of the grid that --visibility voxels asks (worker/scene/voxels.h). Cells have two colours by turns, so that
 * none has that of one beside it. Nothing here is collective. */
#ifndef KILN_COORDINATOR_VIEW_VOXEL_VIEW_H
#define KILN_COORDINATOR_VIEW_VOXEL_VIEW_H

#include "coordinator/view/view.h"
#include "worker/scene/voxels.h"

/* Draws the filled cells as boxes, in three shades by their sides: view rays go from cell to cell. One that has come
 * through the back of a single-sided surface begins there, and one that begins in filled cells sees none until it is
 * out of them. Black: none. The context is a const struct kiln_voxels. */
int kiln_voxel_view_render(void *context, const struct kiln_view_params *params, struct kiln_image **image,
                           struct kiln_error *error);

/* From a place of the source's scene, world, m, to the colour of the cell that it lies in, or to grey where that is not
 * filled; a place that is none, NaN, stays. Thread-safe. */
void kiln_voxel_view_place(const struct kiln_view_source *source, float rgb[3]);

/* `boxes`: of kiln_voxel_view_render; else of places. */
void kiln_voxel_view_key(const struct kiln_voxels *voxels, bool boxes, struct kiln_color_key *key);

#endif
