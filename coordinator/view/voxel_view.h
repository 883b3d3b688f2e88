/* Pictures of the voxel grid of --visibility voxels (worker/scene/voxels.h). Cells are coloured like a 3D checkerboard,
 * so neighbours differ. Nothing here is collective. */
#ifndef KILN_COORDINATOR_VIEW_VOXEL_VIEW_H
#define KILN_COORDINATOR_VIEW_VOXEL_VIEW_H

#include "coordinator/view/view.h"
#include "worker/scene/voxels.h"

/* Draws the filled cells as boxes, with three shades for their sides, by marching view rays from cell to cell. A ray
 * that has passed through the back of a single-sided surface starts there. A ray that starts in filled cells ignores
 * them until it has left them. Rays without a cell are black. The context is a const struct kiln_voxels. */
int kiln_voxel_view_render(void *context, const struct kiln_view_params *params, struct kiln_image **image,
                           struct kiln_error *error);

/* Replaces a position in `rgb` (world, m, in the source's scene) by the colour of its cell, or by grey if the cell is
 * not filled. NaN, no position, stays. Thread-safe. */
void kiln_voxel_view_place(const struct kiln_view_source *source, float rgb[3]);

/* Makes the colour key, for kiln_voxel_view_render with `boxes`, else for kiln_voxel_view_place. */
void kiln_voxel_view_key(const struct kiln_voxels *voxels, bool boxes, struct kiln_color_key *key);

#endif
