/* Divided texels: texels of which a wall that stands on them leaves a part on either side (struct kiln_divided_texel of
 * worker/scene/surface.h). Without them a texel has one light for both sides, and the wall lets light through.
 *
 * A texel is divided if its surface is flat, rays just above it from end to end meet a surface, and then all rays
 * between places on one side of that surface's plane and places on the other side meet fronts, or surfaces with two
 * sides, both ways: nothing goes round the wall within the texel. Where what is met from one side are backs of
 * single-sided surfaces, that side is buried, and the validity pass leaves it out; of glass that is taken as such it is
 * not. A texel stays whole whose neighbours have none on its other side, as in a gap that is narrower than a texel,
 * and in which more than one wall stands, one of them counts.
 *
 * The larger side is the main side, whose light the texel has. Where a wall reaches past another, the larger side may
 * be the rim that is left outdoors, and be seen in the room as a bright line. So of a lightmap's texel the smaller side
 * is the main side where the surface ends within two texels on the larger one, goes on for three times as many on the
 * smaller one, and nothing stands on it there: what a prop at the edge of a table hides is not what is seen. Nor is
 * the cavity of a wall that a door frame is set in: a quarter of the rays of the next texel on that side must see as
 * far as those of the rim, or a metre. Where then no neighbour lies outdoors, rays that meet the rim find the light of
 * the room.
 *
 * What stands between a wall's two faces is lit from nowhere: it is written to the texels, and taken out of
 * surface->visible once that is known (kiln_surface_leave_walls_out). What lies before a face on the other side
 * counts with the light of a neighbour, which is that of another place. */
#ifndef KILN_COORDINATOR_BAKE_DIVIDED_H
#define KILN_COORDINATOR_BAKE_DIVIDED_H

#include "coordinator/surface/surface_build.h"
#include "worker/backend/backend.h"

/* Collective over the ranks of the exchange (NULL: this process is alone). Finds the divided texels, enters them in the
 * surface's global arrays, the same on all ranks, and moves the area of each other side (m2) to the neighbour that
 * stands in for it. All is borrowed but what is entered, which belongs to the surface. The surface's global arrays must
 * not be shared yet, and the backend need not have the surface. KILN_SYSTEM; KILN_STOPPED when `stop` (NULL: none) asks
 * to end. */
int kiln_divide_texels(struct kiln_surface *surface, const struct kiln_scene *scene,
                       const struct kiln_geometry *geometry, struct kiln_backend *backend, uint32_t threads,
                       const struct kiln_surface_exchange *exchange, const struct kiln_stop *stop,
                       struct kiln_error *error);

#endif
