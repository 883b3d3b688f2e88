/* Divided texels: texels that walls cut into parts which nothing passes between (struct kiln_divided_texel of
 * worker/scene/surface.h). Without them a texel has one light for both sides of a wall, and the wall lets light
 * through.
 *
 * Rays just above a flat texel, along its diagonals and sides, find the walls that stand on it (wall_rays.h). The lines
 * of their planes cut it into cells (texel_cells.h). Cells that rays between them pass are joined; what is left apart
 * are the texel's parts, but for cells in which every ray ends inside of a solid: light reaches nothing there. Each
 * part is a surface point (coordinator/surface/parts.h).
 *
 * The lightmap shows the part that a room sees. A cavity is none: nothing above it is far away. Of a room and what lies
 * outdoors beside it the room is shown, and of the others the one from which the surface is seen farther: where walls
 * reach past each other, a rim is left that sees little of it. Of parts that see about as much, the largest is shown.
 *
 * Where a wall stands on the border between two texels, rounding decides which of them a ray meets there. So both are
 * divided, too, into one part each and the strip along the wall, which has no light. */
#ifndef KILN_COORDINATOR_BAKE_POINTS_DIVIDED_H
#define KILN_COORDINATOR_BAKE_POINTS_DIVIDED_H

#include "coordinator/surface/surface_build.h"
#include "worker/backend/backend.h"

/* Collective over the ranks of the exchange (NULL: this process is alone). Finds the divided texels and adds their
 * parts to the surface, the same on all ranks. All is borrowed but what is entered, which belongs to the surface. The
 * surface's global arrays must not be shared yet, and the backend need not have the surface. KILN_SYSTEM; KILN_STOPPED
 * when `stop` (NULL: none) asks to end. */
int kiln_divide_texels(struct kiln_surface *surface, const struct kiln_scene *scene,
                       const struct kiln_geometry *geometry, struct kiln_backend *backend, uint32_t threads,
                       const struct kiln_surface_exchange *exchange, const struct kiln_stop *stop,
                       struct kiln_error *error);

#endif
