/* Divided texels: texels that walls cut into parts with no passage for light between them (struct kiln_divided_texel of
 * worker/scene/surface.h). An undivided texel has one light value for both sides of a wall, so the wall leaks light.
 *
 * Rays just above a flat texel, along its diagonals and sides, find the walls that stand on it (wall_rays.h). The lines
 * of the walls' planes cut the texel into cells (texel_cells.h). Cells are joined if rays pass between them; each group
 * of joined cells is a part of the texel. Cells in which every ray ends inside a solid are left out: no light reaches
 * them. Each part is a surface point (coordinator/surface/parts.h).
 *
 * The lightmap shows the part that a room sees. Cavities, with nothing far away above them, are not shown. A room is
 * preferred to the outdoors beside it. Otherwise the part from which the surface is seen farther is shown: where walls
 * overlap, a rim is left that sees little of the surface. Of parts that see about as much, the largest is shown.
 *
 * Where a wall stands on the border between two texels, rounding decides which texel a ray meets there. So both texels
 * are divided too, each into one part and a strip along the wall, which has no light. */
#ifndef KILN_COORDINATOR_BAKE_POINTS_DIVIDED_H
#define KILN_COORDINATOR_BAKE_POINTS_DIVIDED_H

#include "coordinator/surface/surface_build.h"
#include "worker/backend/backend.h"

/* Collective over the ranks of the exchange (NULL: this process is alone). Finds the divided texels and adds their
 * parts to the surface, the same on all ranks. All arguments are borrowed; the added parts belong to the surface. The
 * surface's global arrays must not be shared yet, and the backend need not have the surface. KILN_SYSTEM; KILN_STOPPED
 * when `stop` (NULL: none) asks to end. */
int kiln_divide_texels(struct kiln_surface *surface, const struct kiln_scene *scene,
                       const struct kiln_geometry *geometry, struct kiln_backend *backend, uint32_t threads,
                       const struct kiln_surface_exchange *exchange, const struct kiln_stop *stop,
                       struct kiln_error *error);

#endif
